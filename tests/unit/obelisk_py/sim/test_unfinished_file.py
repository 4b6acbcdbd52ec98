"""The file of a video is complete or absent, and never replaces another file."""

import errno
import os

import pytest

from obelisk_py.core.sim.mujoco.viewers import video_files
from obelisk_py.core.sim.mujoco.viewers.video_files import unfinished


@pytest.fixture(params=["without a name", "hidden"], autouse=True)
def file_system(request, monkeypatch):
    """A file system that supports unnamed files, and one that does not."""
    if request.param == "without a name":
        return
    really = os.open

    def open_(path, flags, *mode):
        if flags & os.O_TMPFILE == os.O_TMPFILE:
            raise OSError(errno.EOPNOTSUPP, "not supported")
        return really(path, flags, *mode)

    monkeypatch.setattr(video_files.os, "open", open_)


def test_a_file_exists_once_it_is_finished(tmp_path):
    with unfinished(tmp_path) as place:
        place.file.write(b"video")
        assert not (tmp_path / "out.mp4").exists()
        assert place.finish(tmp_path / "out.mp4") == tmp_path / "out.mp4"
    assert [path.name for path in tmp_path.iterdir()] == ["out.mp4"]
    assert (tmp_path / "out.mp4").read_bytes() == b"video"


def test_others_may_read_it_as_any_file_of_the_user(tmp_path):
    (tmp_path / "other").touch()
    with unfinished(tmp_path) as place:
        place.finish(tmp_path / "out.mp4")
    assert (tmp_path / "out.mp4").stat().st_mode == (tmp_path / "other").stat().st_mode


def test_nothing_is_left_of_a_file_that_is_not_finished(tmp_path):
    def begin():
        with unfinished(tmp_path) as place:
            place.file.write(b"fil")
            raise RuntimeError("the encoder")

    with pytest.raises(RuntimeError, match="the encoder"):
        begin()
    assert list(tmp_path.iterdir()) == []


def test_an_existing_file_is_kept(tmp_path):
    for name in ("out.mp4", "out-2.mp4"):
        (tmp_path / name).write_text("mine")
    with unfinished(tmp_path) as place:
        place.file.write(b"video")
        assert place.finish(tmp_path / "out.mp4") == tmp_path / "out-3.mp4"
    assert (tmp_path / "out.mp4").read_text() == "mine"
    assert (tmp_path / "out-3.mp4").read_bytes() == b"video"


def test_a_file_that_appears_at_the_last_moment_is_kept(tmp_path, monkeypatch):
    find = video_files.free_name

    def find_and_lose(path):
        free = find(path)
        if free.name == "out.mp4":
            free.write_text("theirs")
        return free

    monkeypatch.setattr(video_files, "free_name", find_and_lose)
    with unfinished(tmp_path) as place:
        place.file.write(b"video")
        assert place.finish(tmp_path / "out.mp4") == tmp_path / "out-2.mp4"
    assert (tmp_path / "out.mp4").read_text() == "theirs"
    assert (tmp_path / "out-2.mp4").read_bytes() == b"video"


def test_a_missing_folder_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError), unfinished(tmp_path / "none"):
        pass
