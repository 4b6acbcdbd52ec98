"""Programs that share a process: the launcher's file, and how each is run."""

import json
import sys
from pathlib import Path

import pytest

from obelisk_py.core.composition import Program, logger_name, read_programs

MODULE = """
import sys
def quiet(): pass
def exiting(args=None): sys.exit("/".join([__name__, *sys.argv[1:]]))
class Entry:
    @staticmethod
    def code(): return 3
if __name__ == "__main__": sys.exit("/".join([__name__, *sys.argv[1:]]))
"""


@pytest.fixture(autouse=True)
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "programs_example.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "programs_example", raising=False)


def program(function: str | None) -> Program:
    return Program(
        node="/ns/a", module="programs_example", function=function, arguments=("--x", "y")
    )


@pytest.mark.parametrize(
    ("function", "code"),
    [
        ("quiet", None),
        ("exiting", "programs_example/--x/y"),
        ("Entry.code", 3),
        (None, "__main__/--x/y"),
    ],
)
def test_a_program_ends_as_in_its_own_process(function: str | None, code: object) -> None:
    before = list(sys.argv)
    with pytest.raises(SystemExit) as end:
        program(function).run()
    assert end.value.code == code
    assert sys.argv == before


def test_the_file_lists_the_programs_in_order(tmp_path: Path) -> None:
    path = tmp_path / "composed.json"
    listed = [
        {"node": "/ns/a", "module": "m", "function": "main", "arguments": ["--ros-args"]},
        {"node": "/b", "module": "n", "function": None, "arguments": []},
    ]
    path.write_text(json.dumps({"nodes": listed}))
    first, second = read_programs(path)
    assert first == Program(node="/ns/a", module="m", function="main", arguments=("--ros-args",))
    assert (second.node, second.function) == ("/b", None)
    assert (str(first), str(second)) == ("m:main()", "python -m n")


def test_the_logger_of_a_node_has_dots_for_slashes() -> None:
    assert [logger_name(node) for node in ("/a", "/ns/inner/a")] == ["a", "ns.inner.a"]
