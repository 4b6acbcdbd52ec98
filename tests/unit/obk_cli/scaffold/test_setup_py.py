import ast
from collections.abc import Callable
from pathlib import PurePosixPath

import pytest

from obk_cli.scaffold.kinds import Problem
from obk_cli.scaffold.package_files import add_entry_point
from obk_cli.scaffold.templates import RenderedFile

NEW = "new = foo.new:main"


def setup_py(scripts: str) -> str:
    return (
        "# naïve — bytes are not characters\n"
        "from setuptools import setup\n\n"
        f'setup(name="foo", entry_points={{"x": "é", "console_scripts": {scripts}}}, b=1)\n'
    )


def scripts_of(text: str) -> list[str]:
    """Read the list as an independent reader would."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and key.value == "console_scripts":
                    found = ast.literal_eval(value)
                    assert isinstance(found, list)
                    return found
    raise AssertionError(text)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('["a = b:c"]', f'["a = b:c", "{NEW}"]'),
        ('["a = b:c",]', f'["a = b:c", "{NEW}",]'),
        ("[]", f'[\n    "{NEW}",\n]'),
        ('[\n    "a = b:c",\n]', f'[\n    "a = b:c",\n    "{NEW}",\n]'),
        ('[\n    "a = b:c"\n]', f'[\n    "a = b:c",\n    "{NEW}",\n]'),
        ('[\n  "a = b:c"  # é, why\n]', f'[\n  "a = b:c",  # é, why\n  "{NEW}",\n]'),
        ('[\n\t"a = b:c",\n\t# last\n]', f'[\n\t"a = b:c",\n\t# last\n\t"{NEW}",\n]'),
        ('["a = b:c",\n]', f'["a = b:c",\n    "{NEW}",\n]'),
        ('[\r\n    "a = b:c",\r\n]', f'[\r\n    "a = b:c",\r\n    "{NEW}",\r\n]'),
    ],
)
def test_an_entry_point_is_added_and_the_rest_is_kept(before: str, after: str) -> None:
    old = scripts_of(setup_py(before))
    changed = add_entry_point(setup_py(before), NEW)
    assert changed == setup_py(after)
    assert scripts_of(changed) == [*old, NEW]


def test_the_generated_setup_takes_one_more(
    package: Callable[..., dict[PurePosixPath, RenderedFile]],
) -> None:
    text = package()[PurePosixPath("setup.py")].content.decode()
    changed = add_entry_point(text, NEW)
    assert isinstance(changed, str)
    assert scripts_of(changed) == ["foo = foo.foo:main", NEW]


def test_the_same_entry_point_again_changes_nothing() -> None:
    text = setup_py('["new=foo.new:main"]')
    assert add_entry_point(text, NEW) == text


def test_an_executable_of_another_module_is_not_replaced() -> None:
    problem = add_entry_point(setup_py('["new = foo.other:main"]'), NEW)
    assert problem == Problem(
        sentence="setup.py already has the executable `new`: new = foo.other:main",
        help="choose another name",
    )


@pytest.mark.parametrize(
    "text",
    [
        "",
        "setup(",
        setup_py("scripts()"),
        setup_py('["a = b:c", *more]'),
        setup_py('[f"{name} = b:c"]'),
        setup_py('["a = b:c"]') + setup_py('["d = e:f"]'),
        setup_py('["a = b:c"]') + "a" + ".a" * 100_000,
    ],
)
def test_a_complex_setup_is_rejected_with_the_line_to_add(text: str) -> None:
    problem = add_entry_point(text, NEW)
    assert isinstance(problem, Problem)
    assert "cannot be added without changing the rest" in problem.sentence
    assert problem.help is not None
    assert f'"{NEW}"' in problem.help
