"""A user's file in the place of its old self."""

import os
from pathlib import Path

import pytest

from obk_cli.adapters.replace_file import replace_file


def test_mode_and_link_stay(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_bytes(b"old")
    path.chmod(0o604)
    (tmp_path / "link").symlink_to("c.yaml")
    replace_file(tmp_path / "link", b"new")
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
    replace_file(path, b"new")
    assert given == [(owner.st_uid, owner.st_gid)]
    assert path.read_bytes() == b"new"


def test_what_fails_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "c.yaml"
    path.write_bytes(b"old")

    def fail(_: int) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="no space"):
        replace_file(path, b"new")
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == b"old"
