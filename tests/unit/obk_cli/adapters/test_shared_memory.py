"""Segments of the dead go, those of the living stay."""

import fcntl
from pathlib import Path

from obk_cli.adapters.shared_memory import remove_dead_segments

DEAD, ALIVE = "fastrtps_0123456789abcdef", "fastrtps_fedcba9876543210"


def test_only_segments_without_an_owner_go(tmp_path: Path) -> None:
    for name in (DEAD, ALIVE):
        (tmp_path / name).write_bytes(b"data")
        (tmp_path / f"{name}_el").touch()
    with (tmp_path / f"{ALIVE}_el").open() as owner:
        fcntl.flock(owner, fcntl.LOCK_EX)
        assert remove_dead_segments(tmp_path) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == [ALIVE, f"{ALIVE}_el"]


def test_ports_and_foreign_files_stay(tmp_path: Path) -> None:
    names = ["fastrtps_port7411", "fastrtps_port7411_el", "fastrtps_x_el", "sem.other", "notes_el"]
    for name in names:
        (tmp_path / name).touch()
    assert remove_dead_segments(tmp_path) == 0
    assert len(list(tmp_path.iterdir())) == len(names)


def test_a_folder_that_is_not_there_has_none(tmp_path: Path) -> None:
    assert remove_dead_segments(tmp_path / "nowhere") == 0
