"""Types by their names, which come from other nodes in the ROS graph."""

import sys
from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.ros.types import find_type


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of importable packages, each of which records its import."""
    output = "from pathlib import Path\nPath(__file__).with_name('imported').touch()\n"
    for name in ("no_messages", "odd_msgs", "odd_msgs/msg", "no_messages/tool"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(output)
    (tmp_path / "odd_msgs" / "msg" / "__init__.py").write_text("class Odd: ...\nother = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for name in [one for one in sys.modules if one.startswith(("no_messages", "odd_msgs"))]:
        del sys.modules[name]


def test_a_message_is_found(packages: Path) -> None:
    assert find_type("odd_msgs/msg/Odd").__name__ == "Odd"
    assert find_type("odd_msgs/Odd").__name__ == "Odd"


@pytest.mark.parametrize(
    "name",
    [
        "no_messages/msg/Odd",
        "no_messages/tool/Odd",
        "no_messages.tool/msg/Odd",
        "no_messages/__main__/Odd",
        "unittest/__main__/Odd",
        "odd_msgs/msg/../Odd",
        "Odd",
        "",
    ],
)
def test_nothing_is_imported_that_holds_no_messages(packages: Path, name: str) -> None:
    with pytest.raises(CommandFailedError, match="cannot be loaded"):
        find_type(name)
    assert list(packages.rglob("imported")) == []


def test_invalid_types_are_none(packages: Path) -> None:
    with pytest.raises(CommandFailedError, match="the package odd_msgs has no type"):
        find_type("odd_msgs/msg/other")
