"""Segments and ports of dead processes are removed, those of live processes are kept."""

import fcntl
import mmap
import os
import shutil
from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.process.shared_memory import NEEDED, remove_dead_segments, require_shared_memory

DEAD, ALIVE = "fastrtps_0123456789abcdef", "fastrtps_fedcba9876543210"
PORT = ("fastrtps_port7411", "fastrtps_port7411_el", "sem.fastrtps_port7411_mutex")


def make(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).write_bytes(b"data")


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_only_segments_without_an_owner_are_removed(tmp_path: Path) -> None:
    make(tmp_path, DEAD, f"{DEAD}_el", ALIVE, f"{ALIVE}_el")
    with (tmp_path / f"{ALIVE}_el").open() as owner:
        fcntl.flock(owner, fcntl.LOCK_EX)
        assert remove_dead_segments(tmp_path) == 1
    assert names(tmp_path) == [ALIVE, f"{ALIVE}_el"]


def test_an_unused_port_is_removed_with_all_its_files(tmp_path: Path) -> None:
    make(tmp_path, *PORT, "fastrtps_port7000", "fastrtps_port7000_sl")
    make(tmp_path, "fastrtps_port9_el", "sem.fastrtps_port10_mutex")
    assert remove_dead_segments(tmp_path) == 4
    assert names(tmp_path) == []


@pytest.mark.parametrize("used", PORT[::2])
def test_a_mapped_port_is_kept_completely(tmp_path: Path, used: str) -> None:
    make(tmp_path, *PORT)
    with (tmp_path / used).open("r+b") as file:
        memory = mmap.mmap(file.fileno(), 0)
    assert remove_dead_segments(tmp_path) == 0
    assert names(tmp_path) == sorted(PORT)
    memory.close()
    assert remove_dead_segments(tmp_path) == 1


@pytest.mark.parametrize("suffix", ["el", "sl"])
def test_a_port_with_a_live_reader_is_kept(tmp_path: Path, suffix: str) -> None:
    files = ("fastrtps_port7411", f"fastrtps_port7411_{suffix}")
    make(tmp_path, *files)
    with (tmp_path / files[1]).open() as reader:
        fcntl.flock(reader, fcntl.LOCK_SH)
        assert remove_dead_segments(tmp_path) == 0
    assert names(tmp_path) == sorted(files)


def test_foreign_files_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    foreign = ("fastrtps_x_el", "sem.other", "notes_el", "fastrtps_portx", "fastrtps_port1_old")
    make(tmp_path, *foreign)
    assert remove_dead_segments(tmp_path) == 0
    assert names(tmp_path) == sorted(foreign)
    make(tmp_path, *PORT, DEAD, f"{DEAD}_el")
    us = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: us + 1)
    assert remove_dead_segments(tmp_path) == 0


def test_a_missing_folder_has_no_files(tmp_path: Path) -> None:
    assert remove_dead_segments(tmp_path / "nowhere") == 0


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that is full as long as it contains anything."""
    usage = shutil.disk_usage(tmp_path)

    def used(folder: Path) -> object:
        return usage._replace(free=0 if any(folder.iterdir()) else NEEDED)

    monkeypatch.setattr("shutil.disk_usage", used)
    return tmp_path


def test_leftovers_of_dead_processes_are_removed_to_free_space(small: Path) -> None:
    (small / DEAD).touch()
    (small / f"{DEAD}_el").touch()
    require_shared_memory(small)
    assert list(small.iterdir()) == []


def test_memory_that_is_full_nevertheless_is_reported(small: Path) -> None:
    (small / "used").touch()
    with pytest.raises(CommandFailedError, match=f"{small} is full: ") as refused:
        require_shared_memory(small)
    assert refused.value.help is not None
    assert "obk doctor shared-memory" in refused.value.help
    assert [path.name for path in small.iterdir()] == ["used"]


def test_without_shared_memory_ros_is_loaded_anyway(small: Path) -> None:
    require_shared_memory(small / "nowhere")
