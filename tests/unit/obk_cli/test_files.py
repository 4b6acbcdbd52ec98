"""Reading user files; writing whole files, with their permissions."""

import os
import stat
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from obk_cli.diagnostics.source import LONGEST_FILE_BYTES
from obk_cli.errors import CommandFailedError
from obk_cli.files import (
    STANDARD_INPUT,
    STATE_MODE,
    read_bytes,
    unwritable,
    whole_file,
    write_bytes,
    write_text,
)


def test_a_named_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    for name in ("pipe", "link"):
        assert read_bytes(str(tmp_path / name)) == "it is a named pipe"


def test_the_pipe_of_a_shell_is_read() -> None:
    there, here = os.pipe()
    os.write(here, b"config: x")
    os.close(here)
    try:
        assert read_bytes(f"/dev/fd/{there}") == b"config: x"
    finally:
        os.close(there)


def test_a_standard_input_that_was_closed_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    assert read_bytes(STANDARD_INPUT) == "the stream is closed"


def test_endless_files_are_read_in_part() -> None:
    read = read_bytes("/dev/zero")
    assert isinstance(read, bytes)
    assert len(read) == LONGEST_FILE_BYTES + 1


def test_a_file_that_may_not_be_written_is_not_reported_as_one_that_may_not_be_read(
    tmp_path: Path,
) -> None:
    error = unwritable(tmp_path / "x", PermissionError(13, "Permission denied"))
    assert error.message == f"`{tmp_path}/x` cannot be written: permission denied"
    gone = unwritable(tmp_path / "x", FileNotFoundError(2, "No such file or directory"))
    assert gone.message.endswith("cannot be written: file not found")


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("loop", "too many levels of symbolic links"),
        ("gone", "file not found"),
        (".", "it is a directory"),
        ("\0", "embedded null"),
    ],
)
def test_paths_that_are_no_files_are_reported(tmp_path: Path, name: str, reason: str) -> None:
    (tmp_path / "loop").symlink_to("loop")
    reported = read_bytes(f"{tmp_path}/{name}")
    assert isinstance(reported, str)
    assert reported.startswith(reason)


@pytest.fixture
def mask() -> Iterator[int]:
    """A user whose umask allows the group to write, and others nothing."""
    before = os.umask(0o027)
    yield 0o027
    os.umask(before)


def mode_of(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.usefixtures("mask")
def test_a_new_file_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    assert write_text(tmp_path / "new/plan.json", "{}")
    (tmp_path / "other").touch()
    assert mode_of(tmp_path / "new/plan.json") == mode_of(tmp_path / "other") == 0o640


@pytest.mark.usefixtures("mask")
def test_a_file_that_is_replaced_keeps_its_permissions(tmp_path: Path) -> None:
    path = tmp_path / "run.py"
    path.touch()
    path.chmod(0o755)
    assert write_text(path, "pass\n")
    assert (path.read_text(), mode_of(path)) == ("pass\n", 0o755)


def test_private_files_are_private(tmp_path: Path) -> None:
    write_text(tmp_path / "run.json", "{}", mode=STATE_MODE)
    assert mode_of(tmp_path / "run.json") == 0o600


def test_a_file_with_the_same_content_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    write_text(path, "{}")
    before = path.stat()
    assert not write_text(path, "{}")
    after = path.stat()  # reading it may change the time of the last access
    assert (after.st_ino, after.st_ctime_ns) == (before.st_ino, before.st_ctime_ns)


def test_a_link_is_kept_and_its_file_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("file")
    for text in ("first", "second"):
        assert write_text(tmp_path / "link", text)
        assert (tmp_path / "link").is_symlink()
        assert (tmp_path / "file").read_text() == text


def test_a_pipe_receives_the_data_and_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append(path.read_text()), daemon=True)
    reader.start()
    assert write_text(path, "data")
    reader.join()
    assert read == ["data"]
    assert path.is_fifo()
    assert list(tmp_path.iterdir()) == [path]


def test_a_name_with_invalid_utf8_is_written_unchanged(tmp_path: Path) -> None:
    write_text(tmp_path / "setup.sh", os.fsdecode(b"caf\xe9"))
    assert (tmp_path / "setup.sh").read_bytes() == b"caf\xe9"


def test_failures_leave_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "plan.json"
    path.write_bytes(b"old")

    def fail(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OSError, match="no space"):
        write_bytes(path, b"new")
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == b"old"


def test_mode_and_link_stay(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_bytes(b"old")
    path.chmod(0o604)
    (tmp_path / "link").symlink_to("c.yaml")
    write_bytes(tmp_path / "link", b"new")
    assert (path.read_bytes(), path.stat().st_mode & 0o7777) == (b"new", 0o604)
    assert (tmp_path / "link").is_symlink()


@pytest.mark.parametrize("may_give", [True, False])
def test_the_owner_is_kept_if_the_system_allows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, may_give: bool
) -> None:
    path = tmp_path / "c.yaml"
    path.write_bytes(b"old")
    owner = path.stat()
    given: list[tuple[int, int]] = []

    def chown(_: Path, user: int, group: int) -> None:
        given.append((user, group))
        if not may_give:
            raise PermissionError

    monkeypatch.setattr(os, "chown", chown)
    write_bytes(path, b"new")
    assert given == [(owner.st_uid, owner.st_gid)]
    assert path.read_bytes() == b"new"


def test_a_disk_that_fails_at_the_end_leaves_only_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "c.yaml"
    path.write_bytes(b"old")

    def fail(_: int) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="no space"):
        write_bytes(path, b"new")
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == b"old"


def test_a_file_is_written_in_parts_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "new" / "f"
    with whole_file(path) as temporary:
        temporary.write_text("one")
        assert not path.exists()
    (tmp_path / "link").symlink_to(path)
    with whole_file(tmp_path / "link") as temporary:
        temporary.write_text("two")
    assert path.read_text() == "two"
    with pytest.raises(ZeroDivisionError), whole_file(path) as temporary:
        temporary.write_text(str(1 // 0))
    with pytest.raises(CommandFailedError, match="it is a directory"), whole_file(tmp_path) as temp:
        temp.write_text("x")
    with pytest.raises(CommandFailedError, match="cannot be written"), whole_file(path / "x"):
        pass
    assert path.read_text() == "two"
    assert sorted(tmp_path.rglob("*")) == [tmp_path / "link", path.parent, path]
    assert not list(tmp_path.parent.glob(f".{tmp_path.name}.*"))
