"""The folder of ROS's log files, and its fallback."""

import errno
import os
import shutil
from pathlib import Path

import pytest

from obk_cli.ros.environment import set_log_folder
from obk_cli.runs.folder import runs_folder


@pytest.fixture(autouse=True)
def _own_temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))


@pytest.fixture
def blocked(tmp_path: Path) -> Path:
    """A path in which even root cannot create a folder."""
    path = tmp_path / "a file"
    path.touch()
    return path


@pytest.mark.parametrize("name", ["HOME", "ROS_HOME", "ROS_LOG_DIR"])
def test_a_folder_that_ros_can_write_to_or_create_is_kept(tmp_path: Path, name: str) -> None:
    variables = {"HOME": "/no/such", name: str(tmp_path / "to be made")}
    before = dict(variables)
    assert list(set_log_folder(variables)) == []
    assert variables == before
    assert not (tmp_path / "to be made").exists()


def test_a_read_only_home_is_reported_with_the_folder_in_use(tmp_path: Path, blocked: Path) -> None:
    variables = {"HOME": str(blocked)}
    (sentence,) = set_log_folder(variables)
    (folder,) = tmp_path.glob("obk-ros-*")
    assert variables == {"HOME": str(blocked), "ROS_HOME": str(folder)}
    assert sentence == (
        f"ROS cannot write its log files into {blocked}/.ros/log; they are written to {folder}/log"
    )
    assert folder.stat().st_mode & 0o777 == 0o700


def test_a_home_that_is_closed_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Owned by root, as after `sudo -u robot`."""
    closed = tmp_path / "closed"
    closed.mkdir()
    look, may = os.stat, os.access

    def look_if_open(path: "os.PathLike[str] | str", **options: bool) -> os.stat_result:
        if str(path).startswith(f"{closed}/"):
            raise PermissionError(errno.EACCES, "Permission denied")
        return look(path, **options)

    monkeypatch.setattr("os.stat", look_if_open)
    monkeypatch.setattr("os.access", lambda path, mode: path != closed and may(path, mode))
    (sentence,) = set_log_folder({"HOME": str(closed)})
    assert sentence.startswith(
        f"ROS cannot write its log files into {closed}/.ros/log; they are written"
    )


@pytest.mark.parametrize("variables", [{}, {"HOME": ""}, {"ROS_LOG_DIR": "~/logs"}])
def test_without_a_home_another_folder_is_used(variables: dict[str, str]) -> None:
    (sentence,) = set_log_folder(variables)
    assert sentence.startswith(
        "ROS has no folder for its log files, because HOME is not set; they are written"
    )
    assert "ROS_HOME" in variables


def test_a_disk_without_room_for_the_folder_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    variables = {"HOME": str(tmp_path)}
    total = shutil.disk_usage(tmp_path)
    monkeypatch.setattr("shutil.disk_usage", lambda _: total._replace(free=0))
    (sentence,) = set_log_folder(variables)
    assert (
        f"ROS cannot create {tmp_path}/.ros/log for its log files, because the disk is full"
        in sentence
    )
    (tmp_path / ".ros" / "log").mkdir(parents=True)
    assert list(set_log_folder({"HOME": str(tmp_path)})) == []


def test_runs_are_found_in_their_original_folder(blocked: Path) -> None:
    given = {"HOME": "/no/such", "ROS_LOG_DIR": str(blocked)}
    variables = dict(given)
    assert len(list(set_log_folder(variables))) == 1
    assert "ROS_LOG_DIR" not in variables
    assert runs_folder(variables) == runs_folder(given)


def test_a_folder_of_another_user_is_not_taken(
    tmp_path: Path, blocked: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.getuid", lambda: tmp_path.stat().st_uid + 1)
    variables = {"HOME": str(blocked)}
    (sentence,) = set_log_folder(variables)
    assert sentence.startswith("ROS will not start: ROS cannot write its log files into")
    assert "belongs to another user" in sentence
    assert variables == {"HOME": str(blocked)}
