from collections.abc import Callable
from pathlib import Path, PurePosixPath

import pytest

from obk_cli.scaffold.decide import Action, Decision
from obk_cli.scaffold.render import RenderedFile
from obk_cli.scaffold.write import read_existing, write_decisions

Tree = Callable[[Path], dict[str, bytes]]


class Interrupted(BaseException):
    """As a KeyboardInterrupt: no `except Exception` stops it."""


def decision(path: str, content: str, action: Action = Action.CREATE) -> Decision:
    file = RenderedFile(path=PurePosixPath(path), content=content.encode())
    before = b"old" if action is Action.EDIT else None
    return Decision(file=file, action=action, before=before)


def fail_at(monkeypatch: pytest.MonkeyPatch, method: str, count: int) -> None:
    """Interrupt the count-th call of a method of Path, before it does anything."""
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


def test_files_are_added_to_a_folder_that_is_there(tmp_path: Path, tree: Tree) -> None:
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


def test_a_folder_that_cannot_be_written_says_so_and_stays(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        write_decisions(tmp_path / "file/foo", [decision("a", "1")])
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_what_stands_there_is_read(tmp_path: Path) -> None:
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
        f"a symbolic link leads it to {tmp_path / 'elsewhere/x'}"
    )
    assert existing[PurePosixPath("a/x")].reason == "`a` is a file, not a folder"
