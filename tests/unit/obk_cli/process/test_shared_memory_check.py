"""Whether shared memory has room for ROS."""

import shutil
from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.process.shared_memory_check import NEEDED, require_shared_memory

SEGMENT = "fastrtps_0123456789abcdef"


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that is full while there is anything in it."""
    usage = shutil.disk_usage(tmp_path)

    def used(folder: Path) -> object:
        return usage._replace(free=0 if any(folder.iterdir()) else NEEDED)

    monkeypatch.setattr("shutil.disk_usage", used)
    return tmp_path


def test_what_dead_processes_have_left_makes_room(small: Path) -> None:
    (small / SEGMENT).touch()
    (small / f"{SEGMENT}_el").touch()
    require_shared_memory(small)
    assert list(small.iterdir()) == []


def test_memory_that_is_full_nevertheless_is_told(small: Path) -> None:
    (small / "somebody's").touch()
    with pytest.raises(CommandFailedError, match=f"{small} is full: ") as refused:
        require_shared_memory(small)
    assert refused.value.help is not None
    assert "obk doctor shared-memory" in refused.value.help
    assert [path.name for path in small.iterdir()] == ["somebody's"]


def test_without_shared_memory_ros_is_loaded_all_the_same(small: Path) -> None:
    require_shared_memory(small / "nowhere")
