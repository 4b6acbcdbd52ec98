"""Decisions about files, and writing all of them or none."""

from collections.abc import Callable
from pathlib import Path, PurePosixPath

import pytest

from obk_cli.scaffold.templates import RenderedFile
from obk_cli.scaffold.write import (
    Action,
    Decision,
    Existing,
    conflicts,
    decide,
    read_existing,
    write_decisions,
)

PATH = PurePosixPath("a/b.py")
FILE = RenderedFile(path=PATH, content=b"new")


def action(there: Existing | None, *, force: bool = False) -> Action:
    existing = {} if there is None else {PATH: there}
    (decision,) = decide([FILE], existing, force=force)
    return decision.action


def test_a_missing_file_is_created() -> None:
    assert action(None) is Action.CREATE
    assert action(None, force=True) is Action.CREATE


def test_an_identical_file_is_kept() -> None:
    assert action(Existing(content=b"new")) is Action.IDENTICAL
    assert action(Existing(content=b"new"), force=True) is Action.IDENTICAL


def test_another_file_is_rejected_or_replaced_with_force() -> None:
    assert action(Existing(content=b"old")) is Action.CONFLICT
    assert action(Existing(content=b"old"), force=True) is Action.REPLACE


def test_paths_that_are_no_files_are_rejected_even_with_force() -> None:
    assert action(Existing(content=None, reason="it is a directory"), force=True) is Action.CONFLICT


def test_an_edit_needs_the_file_that_it_edits() -> None:
    (gone,) = decide([], {}, edits=[FILE])
    (changed,) = decide([], {PATH: Existing(content=b"old")}, edits=[FILE])
    (same,) = decide([], {PATH: Existing(content=b"new")}, edits=[FILE])
    assert [gone.action, changed.action, same.action] == [
        Action.CONFLICT,
        Action.EDIT,
        Action.IDENTICAL,
    ]
    assert gone.reason == "it no longer exists"


def test_conflicts_are_reported_with_their_reason() -> None:
    decisions = decide([FILE], {PATH: Existing(content=b"old")})
    assert [d.reason for d in conflicts(decisions)] == ["it has different content"]
    assert conflicts(decide([FILE], {})) == ()


Tree = Callable[[Path], dict[str, bytes]]


class Interrupted(BaseException):
    """Like a KeyboardInterrupt: no `except Exception` catches it."""


def decision(path: str, content: str, action: Action = Action.CREATE) -> Decision:
    file = RenderedFile(path=PurePosixPath(path), content=content.encode())
    before = b"old" if action is Action.EDIT else None
    return Decision(file=file, action=action, before=before)


def fail_at(monkeypatch: pytest.MonkeyPatch, method: str, count: int) -> None:
    """Interrupt the count-th call of a method of Path, before it has an effect."""
    original = getattr(Path, method)
    calls = iter(range(1, 1000))

    def call(self: Path, *args: object, **kwargs: object) -> object:
        if next(calls) == count:
            raise Interrupted
        return original(self, *args, **kwargs)

    monkeypatch.setattr(Path, method, call)


def test_a_new_package_is_written_with_its_modes(tmp_path: Path, tree: Tree) -> None:
    root = tmp_path / "src" / "foo"
    write_decisions(root, [decision("a/b.py", "code"), decision("run", "#!/bin/sh\n")])
    assert tree(tmp_path) == {"src/foo/a/b.py": b"code", "src/foo/run": b"#!/bin/sh\n"}
    assert (root / "a/b.py").stat().st_mode & 0o777 == 0o644
    assert (root / "run").stat().st_mode & 0o777 == 0o755
    assert root.stat().st_mode & 0o777 == 0o755


@pytest.mark.parametrize(
    ("method", "count"), [("write_bytes", 1), ("write_bytes", 2), ("chmod", 2), ("rename", 1)]
)
def test_a_new_package_interrupted_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str, count: int
) -> None:
    fail_at(monkeypatch, method, count)
    with pytest.raises(Interrupted):
        write_decisions(tmp_path / "src/foo", [decision("a", "1"), decision("b/c", "2")])
    assert list(tmp_path.iterdir()) == []


def test_files_are_added_to_an_existing_folder(tmp_path: Path, tree: Tree) -> None:
    (tmp_path / "foo").mkdir()
    (tmp_path / "foo/setup.py").write_text("old")
    (tmp_path / "foo/setup.py").chmod(0o600)
    (tmp_path / "foo/kept").write_text("kept")
    write_decisions(
        tmp_path / "foo",
        [
            decision("setup.py", "new", Action.EDIT),
            decision("x/y.py", "y"),
            decision("kept", "kept", Action.IDENTICAL),
        ],
    )
    assert tree(tmp_path) == {"foo/setup.py": b"new", "foo/kept": b"kept", "foo/x/y.py": b"y"}
    assert (tmp_path / "foo/setup.py").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("count", [1, 2, 3])
def test_an_interrupted_addition_is_undone(
    tmp_path: Path, tree: Tree, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    (tmp_path / "foo").mkdir()
    (tmp_path / "foo/setup.py").write_text("old")
    before = tree(tmp_path)
    fail_at(monkeypatch, "replace", count)
    with pytest.raises(Interrupted):
        write_decisions(
            tmp_path / "foo",
            [
                decision("setup.py", "new", Action.EDIT),
                decision("x/y.py", "y"),
                decision("z", "z"),
            ],
        )
    assert tree(tmp_path) == before
    assert [path.name for path in (tmp_path / "foo").iterdir()] == ["setup.py"]
    assert [path.name for path in tmp_path.iterdir()] == ["foo"]


def test_a_read_only_folder_is_reported_and_kept(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        write_decisions(tmp_path / "file/foo", [decision("a", "1")])
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_existing_entries_are_read(tmp_path: Path) -> None:
    (tmp_path / "foo/sub").mkdir(parents=True)
    (tmp_path / "foo/a").write_bytes(b"a\r\n")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "foo/link").symlink_to(tmp_path / "elsewhere")
    paths = [PurePosixPath(p) for p in ("a", "sub", "link/x", "a/x", "missing")]
    existing = read_existing(tmp_path / "foo", paths)
    assert {str(path): there.content for path, there in existing.items()} == {
        "a": b"a\r\n",
        "sub": None,
        "link/x": None,
        "a/x": None,
    }
    assert existing[PurePosixPath("link/x")].reason == (
        f"a symbolic link redirects it to {tmp_path / 'elsewhere/x'}"
    )
    assert existing[PurePosixPath("a/x")].reason == "`a` is a file, not a folder"
