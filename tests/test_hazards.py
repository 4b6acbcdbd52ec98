"""What the code never does to a text or to bytes: make objects of them, or hand them to a shell."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[1] / "src"
MODULES = frozenset({"dill", "marshal", "pickle", "shelve"})
CALLS = frozenset({"eval", "exec", "os.popen", "os.system", "tempfile.mktemp", "yaml.load"})
NAMED = {
    # Its text is made of slots of generated classes.
    "obelisk_py/core/codecs/layout.py: exec(source, names)",
}
"""The exceptions; SECURITY.md gives the reasons."""


def hazards(source: str) -> Iterator[str]:
    """The places in a source text that could make something run."""
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Import(names=names):
                found = any(name.name.partition(".")[0] in MODULES for name in names)
            case ast.ImportFrom(module=str(module)):
                found = module.partition(".")[0] in MODULES
            case ast.Call(func=function, keywords=keywords):
                is_called = ast.unparse(function) in CALLS
                found = is_called or any(keyword.arg == "shell" for keyword in keywords)
            case _:
                found = False
        if found:
            yield ast.unparse(node)


def test_nothing_makes_objects_of_bytes_or_asks_a_shell() -> None:
    found = {
        f"{path.relative_to(SOURCES)}: {hazard}"
        for path in SOURCES.rglob("*.py")
        for hazard in hazards(path.read_text(encoding="utf-8"))
    }
    assert found == NAMED


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from marshal import loads",
        "run('ls', shell=True)",
        "eval('1')",
        "os.system('ls')",
        "tempfile.mktemp()",
        "yaml.load(text, Loader=yaml.Loader)",
    ],
)
def test_each_of_them_is_found(source: str) -> None:
    assert list(hazards(source)) == [ast.unparse(ast.parse(source).body[0])]


def test_what_only_sounds_like_them_is_not() -> None:
    assert list(hazards("import json\nmodel.eval()\nrun(['ls'])\nyaml.safe_load(text)")) == []
