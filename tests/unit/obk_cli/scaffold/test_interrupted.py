"""After an interrupt or a failure at any step, nothing is left behind and nothing is lost."""

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path, PurePosixPath

import pytest

from obk_cli.scaffold.templates import RenderedFile
from obk_cli.scaffold.write import Action, Decision, decide, read_existing, write_decisions

Tree = Callable[[Path], dict[str, bytes]]

STEPS = ("mkdir", "write_bytes", "chmod", "replace", "rename", "read_bytes", "exists")
"""The file operations of `write`, by the methods of Path."""
NEW = [RenderedFile(path=PurePosixPath(path), content=b"new") for path in ("a", "b/c", "b/d/e")]
NO_ROOM = OSError(errno.ENOSPC, "No space left on device")


def whole(root: Path) -> dict[str, bytes | None]:
    """Everything below a folder, including folders and hidden files."""
    return {
        path.relative_to(root).as_posix(): path.read_bytes() if path.is_file() else None
        for path in root.rglob("*")
    }


def plan(root: Path) -> tuple[Decision, ...]:
    edits = [RenderedFile(path=PurePosixPath("mine"), content=b"edited")] if root.exists() else []
    paths = [file.path for file in (*NEW, *edits)]
    decisions = decide(NEW, read_existing(root, paths), edits=edits)
    return decisions[::-1]  # so that there are steps after an edit


class Failing:
    """The n-th step raises; the later steps that undo it work."""

    def __init__(self, patch: pytest.MonkeyPatch, at: int, fault: BaseException) -> None:
        self.count = 0
        for name in STEPS:
            patch.setattr(Path, name, self._stepping(getattr(Path, name), at, fault))

    def _stepping(
        self, original: Callable[..., object], at: int, fault: BaseException
    ) -> Callable[..., object]:
        def step(path: Path, *args: object, **kwargs: object) -> object:
            self.count += 1
            if self.count == at:
                raise fault
            return original(path, *args, **kwargs)

        return step


def steps_of(root: Path) -> int:
    """The number of steps in an undisturbed run."""
    decisions = plan(root)
    with pytest.MonkeyPatch.context() as patch:
        counter = Failing(patch, 0, NO_ROOM)
        write_decisions(root, decisions)
    return counter.count


def prepare(root: Path, *, exists: bool) -> None:
    (root.parent if exists else root.parents[1]).mkdir(parents=True, exist_ok=True)
    if exists:
        root.mkdir()
        (root / "mine").write_bytes(b"mine")
        (root / "b").mkdir()


@pytest.mark.parametrize("exists", [False, True], ids=["new folder", "folder that is there"])
@pytest.mark.parametrize("fault", [KeyboardInterrupt(), NO_ROOM], ids=["interrupt", "disk full"])
def test_after_a_failure_at_any_step_everything_is_as_before(
    tmp_path: Path, fault: BaseException, exists: bool
) -> None:
    prepare(tmp_path / "trial/src/foo", exists=exists)
    count = steps_of(tmp_path / "trial/src/foo")
    assert count > 10
    for at in range(1, count + 1):
        folder = tmp_path / str(at)
        root = folder / "src/foo"
        prepare(root, exists=exists)
        before, decisions = whole(folder), plan(root)
        with pytest.MonkeyPatch.context() as patch:
            Failing(patch, at, fault)
            with pytest.raises(type(fault)):
                write_decisions(root, decisions)
        assert whole(folder) == before, f"step {at} of {count}"


def test_a_file_that_has_changed_since_the_check_is_kept(tmp_path: Path) -> None:
    root = tmp_path / "foo"
    prepare(tmp_path / "foo", exists=True)
    decisions = plan(root)
    (root / "mine").write_bytes(b"changed by the user")
    (root / "a").write_bytes(b"created by the user")
    before = whole(tmp_path)
    with pytest.raises(OSError, match="has changed in the meantime"):
        write_decisions(root, decisions)
    assert whole(tmp_path) == before


def test_files_that_the_user_keeps_are_kept(tmp_path: Path) -> None:
    root = tmp_path / "foo"
    prepare(root, exists=True)
    kept = Decision(
        file=RenderedFile(path=PurePosixPath("mine"), content=b"new"), action=Action.KEEP
    )
    write_decisions(root, [kept])
    assert whole(root) == {"mine": b"mine", "b": None}


@pytest.mark.parametrize("count", [1, 5, 20])
def test_ctrl_c_in_the_middle_leaves_nothing(tmp_path: Path, count: int) -> None:
    """Uses a separate process and a real signal, sent while the count-th file is written."""
    code = f"""
import os, signal, sys
from pathlib import Path
original, calls = Path.write_bytes, iter(range(1, 1000))
def write_bytes(self, data):
    if next(calls) == {count}:
        os.kill(os.getpid(), signal.SIGINT)
    return original(self, data)
Path.write_bytes = write_bytes
from obk_cli.cli.main import main
main(["init", "my_robot"])
"""
    (tmp_path / "here").mkdir()
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path / "here",
        env=os.environ | {"XDG_CONFIG_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert (done.returncode, done.stderr) == (130, "")
    assert whole(tmp_path / "here") == {}


@pytest.mark.usefixtures("unmeasured")
def test_a_disk_without_room_is_reported_and_nothing_is_left(tmp_path: Path) -> None:
    """The file size limit of the process simulates a full disk."""
    code = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
from obk_cli.cli.main import main
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
main(["new", "controller", "foo"])
"""
    (tmp_path / "here").mkdir()
    done = subprocess.run(
        [sys.executable, "-B", "-c", code],  # the limit would also truncate bytecode
        cwd=tmp_path / "here",
        env=os.environ | {"XDG_CONFIG_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    assert "nothing was created" in done.stderr
    assert "Traceback" not in done.stderr
    assert whole(tmp_path / "here") == {}
