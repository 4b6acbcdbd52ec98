"""Templates with hostile names and contents give files below the package, or an error message."""

from pathlib import PurePosixPath

from hypothesis import given
from hypothesis import strategies as st

from obk_cli.scaffold.templates import Template, TemplateFaultError, render_templates

from .hostile import SPOILT

VARIABLES = {"node": "arm", "package": "demo", "types": ("a", "b")}
PIECES = st.sampled_from(
    (
        *("{{ node }}", "{{ package }}", "{{ none }}", "{{ types }}", "{{ node", "{%", "%}", "{#"),
        *("{% for t in types %}", "{% endfor %}", "{% raw %}", "{{ ''.__class__ }}", "{{ 1 / 0 }}"),
        *("/", "//", "..", "../", ".git", "\\", ".py", ".jinja", "src", "~", "\udcff", "\n", ""),
    )
)
NAMES = st.lists(PIECES | SPOILT, min_size=1, max_size=4).map("".join)
TEXTS = st.lists(PIECES | st.text(max_size=9), max_size=5).map("".join)


def utf8(text: str) -> bytes:
    return text.encode(errors="surrogateescape")


@given(st.lists(st.tuples(NAMES, TEXTS), min_size=1, max_size=3))
def test_a_template_of_any_name_creates_a_file_below_the_package_or_nothing(
    drawn: list[tuple[str, str]],
) -> None:
    templates = [Template(name=name, content=utf8(text)) for name, text in drawn]
    try:
        files = render_templates(templates, VARIABLES)
    except TemplateFaultError:
        return
    paths = [file.path for file in files]
    assert len({*paths}) == len(paths)
    for path in paths:
        assert path != PurePosixPath()
        assert not path.is_absolute()
        assert not {"..", ".git"} & {*path.parts}
        assert str(path).isprintable()
