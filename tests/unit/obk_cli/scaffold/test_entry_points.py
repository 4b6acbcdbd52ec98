"""Entry points in setup.cfg and pyproject.toml; those in setup.py have their own test file."""

import configparser
import tomllib

import pytest

from obk_cli.scaffold.kinds import Problem
from obk_cli.scaffold.package_files import PackageTexts, add_console_script

NEW = "new = foo.new:main"
HEADER = "[options.entry_points]\n"
CFG = "# mine\n[metadata]\nname = foo\n\n[options]\npackages = find:\n"
TOML = '# mine\n[project]\nname = "foo" # why\nversion = "1"\n'


def in_cfg(text: str) -> str | Problem:
    changed = add_console_script(
        PackageTexts(
            package_xml="", setup_py="from setuptools import setup\n\nsetup()\n", setup_cfg=text
        ),
        NEW,
    )
    return changed if isinstance(changed, Problem) else changed["setup.cfg"]


def in_toml(text: str) -> str | Problem:
    changed = add_console_script(PackageTexts(package_xml="", pyproject=text), NEW)
    return changed if isinstance(changed, Problem) else changed["pyproject.toml"]


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (CFG, f"{CFG}\n[options.entry_points]\nconsole_scripts =\n    {NEW}\n"),
        (
            f"{CFG}[options.entry_points]\nconsole_scripts =\n  a = b:c ; é\n",
            f"{CFG}[options.entry_points]\nconsole_scripts =\n  a = b:c ; é\n  {NEW}\n",
        ),
        (
            f"{CFG}{HEADER}console_scripts = a = b:c\n# end\n[x]\ny = 1\n",
            f"{CFG}{HEADER}console_scripts = a = b:c\n    {NEW}\n# end\n[x]\ny = 1\n",
        ),
        (
            f"{HEADER}console_scripts =\n\ta = b:c\n\n\t# last\n\nother =\n\tz = y:x\n[x]\n",
            f"{HEADER}console_scripts =\n\ta = b:c\n\t{NEW}\n\n\t# last\n\n"
            "other =\n\tz = y:x\n[x]\n",
        ),
        (
            "[options.entry_points]\nother =\n    z = y:x\n",
            f"[options.entry_points]\nconsole_scripts =\n    {NEW}\nother =\n    z = y:x\n",
        ),
        (
            "[options.entry_points]\r\nconsole_scripts =\r\n    a = b:c\r\n",
            f"[options.entry_points]\r\nconsole_scripts =\r\n    a = b:c\r\n    {NEW}\r\n",
        ),
        (
            "[options.entry_points]\nconsole_scripts =\n    a = b:c",
            f"[options.entry_points]\nconsole_scripts =\n    a = b:c\n    {NEW}",
        ),
    ],
)
def test_setup_cfg_gets_one_more_line_and_keeps_the_rest(before: str, after: str) -> None:
    assert in_cfg(before) == after
    parser = configparser.ConfigParser(interpolation=None)
    parser.read_string(after)
    assert NEW in parser["options.entry_points"]["console_scripts"].splitlines()


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (TOML, f'{TOML}\n[project.scripts]\nnew = "foo.new:main"\n'),
        (
            f'{TOML}\n[project.scripts] # é\na = "b:c" # why\n\n# next\n[tool.x]\ny = 1\n',
            f'{TOML}\n[project.scripts] # é\na = "b:c" # why\nnew = "foo.new:main"\n\n'
            "# next\n[tool.x]\ny = 1\n",
        ),
        (
            f"{TOML}[project.scripts]\n[tool.x]\ny = 1\n",
            f'{TOML}[project.scripts]\nnew = "foo.new:main"\n[tool.x]\ny = 1\n',
        ),
        (
            f'{TOML}[project.scripts]\r\n  a = "b:c"\r\n',
            f'{TOML}[project.scripts]\r\n  a = "b:c"\r\n  new = "foo.new:main"\r\n',
        ),
    ],
)
def test_pyproject_gets_one_more_line_and_keeps_the_rest(before: str, after: str) -> None:
    assert in_toml(before) == after
    assert tomllib.loads(after)["project"]["scripts"]["new"] == "foo.new:main"


@pytest.mark.parametrize(
    "text",
    [
        'scripts = {a = "b:c"}\n[project]\nname = "foo"\nscripts = {a = "b:c"}\n',
        '[project]\nname = "foo"\nscripts.a = "b:c"\n',
        '[project]\nname = "foo"\ntext = """\n[project.scripts]\n"""\n',
    ],
)
def test_scripts_that_are_written_otherwise_are_reported_with_the_line_to_add(text: str) -> None:
    problem = in_toml(text)
    assert isinstance(problem, Problem)
    assert "without changing the rest" in problem.sentence
    assert problem.help is not None
    assert 'new = "foo.new:main"' in problem.help


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "[options.entry_points]\nconsole_scripts =\n    new = foo.other:main\n",
            "setup.cfg already has",
        ),
        ("", "setup.py has no plain list"),
        ("not a cfg", "setup.py has no plain list"),
    ],
)
def test_setup_cfg_that_cannot_take_it_is_reported(text: str, sentence: str) -> None:
    problem = in_cfg(text)
    assert isinstance(problem, Problem)
    assert sentence in problem.sentence


def test_an_executable_of_another_module_is_not_replaced() -> None:
    problem = in_toml(f'{TOML}[project.scripts]\nnew = "foo.other:main"\n')
    assert isinstance(problem, Problem)
    assert problem.sentence == (
        "pyproject.toml already has the executable `new`: new = foo.other:main"
    )


def test_the_same_entry_point_again_changes_nothing() -> None:
    text = "[options.entry_points]\nconsole_scripts =\n    new=foo.new:main\n"
    assert in_cfg(text) == text


def test_scripts_of_setup_py_are_extended() -> None:
    setup_py = 'setup(entry_points={"console_scripts": ["a = b:c"]})\n'
    texts = PackageTexts(package_xml="", setup_py=setup_py, setup_cfg=CFG, pyproject=TOML)
    changed = add_console_script(texts, NEW)
    assert isinstance(changed, dict)
    assert list(changed) == ["setup.py"]
