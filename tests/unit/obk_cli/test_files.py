"""Files written whole, with the permissions that they ought to have."""

import os
import stat
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from obk_cli.files import STATE_MODE, write_bytes, write_text


@pytest.fixture
def mask() -> Iterator[int]:
    """A user who lets his group write and others nothing."""
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


def test_what_is_its_owners_alone_is_so(tmp_path: Path) -> None:
    write_text(tmp_path / "run.json", "{}", mode=STATE_MODE)
    assert mode_of(tmp_path / "run.json") == 0o600


def test_a_file_that_holds_it_already_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    write_text(path, "{}")
    before = path.stat()
    assert not write_text(path, "{}")
    assert path.stat() == before


def test_a_link_stays_and_its_file_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("file")
    for text in ("first", "second"):
        assert write_text(tmp_path / "link", text)
        assert (tmp_path / "link").is_symlink()
        assert (tmp_path / "file").read_text() == text


def test_a_pipe_takes_the_data_and_stays_a_pipe(tmp_path: Path) -> None:
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


def test_a_name_that_is_no_utf8_is_written_as_it_is(tmp_path: Path) -> None:
    write_text(tmp_path / "setup.sh", os.fsdecode(b"caf\xe9"))
    assert (tmp_path / "setup.sh").read_bytes() == b"caf\xe9"


def test_what_fails_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
def test_the_owner_stays_where_the_system_lets_it(
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


def test_a_disk_that_fails_at_the_end_leaves_the_old_file_and_nothing_else(
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
