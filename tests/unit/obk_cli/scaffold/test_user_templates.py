"""User templates, including harmful ones."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.scaffold.templates import Template, TemplateFaultError, render_templates

from .new_command import obk_new, refused

Tree = Callable[[Path], dict[str, bytes]]


@pytest.fixture(autouse=True)
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder, without templates in the user's folder."""
    folder = tmp_path / "ws"
    (folder / "src").mkdir(parents=True)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("OBK_TEMPLATES", raising=False)
    return folder


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A folder with a custom template for Python packages."""
    folder = tmp_path / "mine"
    (folder / "package_py").mkdir(parents=True)
    (folder / "package_py" / "LICENSE.jinja").write_text("Licence of {{ package }}\n")
    return folder


def test_they_extend_the_built_in_ones(workspace: Path, mine: Path) -> None:
    (mine / "package_py" / "setup.py").write_text("# mine\n")
    obk_new("controller", "foo", "--templates", str(mine))
    root = workspace / "src/foo"
    assert (root / "LICENSE").read_text() == "Licence of foo\n"
    assert (root / "setup.py").read_text() == "# mine\n"
    assert (root / "foo/foo.py").is_file()


def test_the_folder_may_be_named_by_the_environment_or_be_the_users_config(
    workspace: Path, mine: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("OBK_TEMPLATES", str(mine))
    obk_new("controller", "foo")
    monkeypatch.delenv("OBK_TEMPLATES")
    (tmp_path / "config/obk").mkdir(parents=True)
    mine.rename(tmp_path / "config/obk/templates")
    obk_new("controller", "bar")
    for name in ("foo", "bar"):
        assert (workspace / "src" / name / "LICENSE").is_file()


def test_the_list_shows_the_source_of_each_template(mine: Path) -> None:
    output = obk_new("--list", "--templates", str(mine))
    assert f"package_py (obk, {mine / 'package_py'})" in output
    assert "controller_cpp (obk)" in output
    listed = json.loads(obk_new("--list", "--format", "json"))
    assert {(entry["kind"], entry["language"]) for entry in listed} >= {
        ("controller", "py"),
        ("controller", "cpp"),
        ("estimator", "cpp"),
        ("robot", "py"),
        ("sensor", "py"),
        ("msgs", None),
        ("config", None),
    }


def test_a_folder_that_no_kind_has_is_reported_with_the_near_one(mine: Path) -> None:
    (mine / "contoller_py").mkdir()
    fault = refused("controller", "foo", "--templates", str(mine))
    assert f"{mine / 'contoller_py'} does not match any template folder" in fault.message
    assert fault.help is not None
    assert "controller_py" in fault.help


def test_a_folder_that_is_not_there_is_reported(mine: Path) -> None:
    assert "does not exist" in refused("controller", "foo", "--templates", f"{mine}x").message


@pytest.mark.parametrize("what", ["file", "folder", "dangling"])
def test_a_link_in_the_folder_is_not_followed(
    mine: Path, workspace: Path, tree: Tree, what: str
) -> None:
    secret = mine.parent / "secret"
    if what == "file":
        secret.write_text("secret")
    elif what == "folder":
        secret.mkdir()
    (mine / "package_py/stolen").symlink_to(secret)
    fault = refused("controller", "foo", "--templates", str(mine))
    assert isinstance(fault, CommandFailedError)
    assert "is a symbolic link" in fault.message
    assert tree(workspace) == {}


@pytest.mark.parametrize(
    "name",
    [
        "{{ '..' }}{{ '\\x2f' }}x",
        "{{ '\\x2f' }}tmp{{ '\\x2f' }}x",
        "{{ '..' }}",
        "{{ '' }}",
        "a{{ '\\x5c' }}b",
        "a{{ '\\n' }}b",
        ".git{{ '\\x2f' }}hooks{{ '\\x2f' }}pre-commit",
        "a{{ '\\x2f' }}..{{ '\\x2f' }}..{{ '\\x2f' }}x",
    ],
)
def test_a_file_name_that_leads_out_is_rejected(
    mine: Path, workspace: Path, tree: Tree, name: str
) -> None:
    (mine / "package_py" / name).write_text("x")
    fault = refused("controller", "foo", "--templates", str(mine))
    assert "outside the package" in fault.message
    assert str(mine) in fault.message
    assert tree(workspace) == {}


@pytest.mark.parametrize(
    "text",
    [
        "{{ ''.__class__.__mro__[1].__subclasses__() }}",
        "{{ package.__init__.__globals__ }}",
        "{{ self.__init__.__globals__ }}",
        "{{ cycler.__init__.__globals__.os.system('id') }}",
        "{% set _ = dependencies.append('x') %}",
        "{{ '{0.__class__}'.format(package) }}",
        "{% include '/etc/passwd' %}",
        "{{ undefined_thing }}",
        "{% for x in %}",
        "{{ 1 / 0 }}",
        "{{ range(1000000000) }}",
    ],
)
def test_a_text_that_reaches_out_or_is_broken_is_rejected_with_its_file(
    mine: Path, workspace: Path, tree: Tree, text: str
) -> None:
    bad = mine / "package_py" / "bad.jinja"
    bad.write_text(text)
    fault = refused("controller", "foo", "--templates", str(mine))
    assert isinstance(fault, TemplateFaultError)
    assert str(bad) in fault.message
    assert tree(workspace) == {}


@pytest.mark.parametrize(
    "text",
    [
        "{{ 'x' * 10 ** 10 }}",
        "{% macro again() %}{{ again() }}{% endmacro %}{{ again() }}",
        "{% for a in range(1000) %}{% for b in range(1000) %}{% endfor %}{% endfor %}",
        "{{ 9 ** (9 ** 9) }}",
        "{% for a in range(40) %}{{ 'x' * 2 ** 20 }}{% endfor %}",
    ],
)
def test_a_text_that_asks_for_too_much_is_stopped(
    mine: Path, workspace: Path, tree: Tree, text: str
) -> None:
    (mine / "package_py" / "bad.jinja").write_text(text)
    fault = refused("controller", "foo", "--templates", str(mine))
    assert isinstance(fault, TemplateFaultError)
    assert str(mine) in fault.message
    assert tree(workspace) == {}


def test_a_template_of_excessive_size_is_rejected(mine: Path) -> None:
    (mine / "package_py" / "big").write_bytes(b"x" * (1024 * 1024 + 1))
    assert "1048577 bytes" in refused("controller", "foo", "--templates", str(mine)).message


def test_two_templates_of_one_file_are_rejected(mine: Path, workspace: Path, tree: Tree) -> None:
    (mine / "package_py" / "{{package}}").mkdir()
    (mine / "package_py" / "{{package}}" / "__init__.py").write_text("")
    fault = refused("controller", "foo", "--templates", str(mine))
    assert fault.message == "two templates would create `foo/__init__.py`"
    assert tree(workspace) == {}


def test_usual_computations_of_a_template_are_within_the_bounds() -> None:
    text = b"{% for i in range(3) %}{{ i * 2 }}{{ '-' * 4 }}{{ 2 ** 10 }}{{ 2 ** -1 }}{% endfor %}"
    (file,) = render_templates([Template(name="a.jinja", content=text)], {})
    assert file.content == b"0----10240.52----10240.54----10240.5"
