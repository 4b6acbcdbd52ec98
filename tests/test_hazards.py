"""The code never creates objects from text or bytes, calls a shell, or contacts another host."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from .parsed import parsed

SOURCES = Path(__file__).parents[1] / "src"
MODULES = frozenset(
    "dill marshal pickle shelve "
    "ftplib http.client httpx requests smtplib urllib.request urllib3".split()
)
CALLS = frozenset(
    "eval exec os.popen os.system subprocess.getoutput subprocess.getstatusoutput tempfile.mktemp "
    "yaml.full_load yaml.load yaml.load_all yaml.unsafe_load".split()
)
LAST_NAMES = {name.rpartition(".")[2] for name in CALLS}
KEYWORDS = frozenset({"allow_pickle", "shell"})
NAMED = {
    # Its text consists of slots of generated classes.
    "obelisk_py/core/serialization/layout.py: exec(source, names)",
    # The program of a node, which the launcher writes and would otherwise pass to `python -c`.
    "obk_cli/process/preload.py: exec(compile(target, '<string>', 'exec'), main_module.__dict__)",
}
"""The exceptions; SECURITY.md gives the reasons."""


def is_named(name: str) -> bool:
    """Whether an import is one of the modules, in one of them, or one of the functions."""
    return name in CALLS or any(f"{name}.".startswith(f"{module}.") for module in MODULES)


def last_name(function: ast.expr) -> str | None:
    """`system` of `os.system`; None if it is neither a name nor an attribute."""
    return getattr(function, "attr", None) or getattr(function, "id", None)


def hazards(tree: ast.Module) -> Iterator[str]:
    """The locations in a source file that could execute something or reach another host."""
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                found = any(is_named(name.name) for name in names)
            case ast.ImportFrom(module=str(module), names=names):
                found = any(is_named(f"{module}.{name.name}") for name in names)
            case ast.Call(func=function, keywords=keywords):
                is_called = last_name(function) in LAST_NAMES and ast.unparse(function) in CALLS
                found = is_called or any(keyword.arg in KEYWORDS for keyword in keywords)
            case _:
                found = False
        if found:
            yield ast.unparse(node)


def test_nothing_makes_objects_of_bytes_or_asks_a_shell_or_another_host() -> None:
    found = {
        f"{path.relative_to(SOURCES)}: {hazard}"
        for path in SOURCES.rglob("*.py")
        for hazard in hazards(parsed(path))
    }
    assert found == NAMED


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "import urllib.request",
        "from urllib import request",
        "from http.client import HTTPConnection",
        "from os import system",
        "numpy.load(file, allow_pickle=True)",
        "from marshal import loads",
        "run('ls', shell=True)",
        "eval('1')",
        "os.system('ls')",
        "tempfile.mktemp()",
        "yaml.load(text, Loader=yaml.Loader)",
    ],
)
def test_each_of_them_is_found(source: str) -> None:
    tree = ast.parse(source)
    assert list(hazards(tree)) == [ast.unparse(tree.body[0])]


def test_similar_names_are_not_found() -> None:
    sound = (
        "import http, json\nfrom urllib.parse import quote\n"
        "model.eval()\nrun(['ls'])\nyaml.safe_load(text)"
    )
    assert list(hazards(ast.parse(sound))) == []
