"""Existing files on a real terminal: the user is asked about each."""

import fcntl
import os
import select
import subprocess
import sys
import termios
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import pytest

from obk_cli.cli.new import app
from obk_cli.cli.new_run import resolve_conflicts
from obk_cli.scaffold.templates import RenderedFile
from obk_cli.scaffold.write import Action, Decision

from .new_command import printed_by

DEADLINE_S = 30.0
QUESTION = b"[q]uit? "


class Dialogue:
    """`obk new controller foo` on a pseudo terminal."""

    def __init__(self, folder: Path) -> None:
        self.master, slave = os.openpty()
        code = "from obk_cli.cli.main import main; main(['new', 'controller', 'foo'])"
        self.process = subprocess.Popen(
            [sys.executable, "-c", code],
            cwd=folder,
            env=os.environ | {"XDG_CONFIG_HOME": str(folder)},
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
            # Its own controlling terminal, so that Ctrl-C there is a signal.
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )
        os.close(slave)
        self.seen = b""

    def answer(self, key: str) -> None:
        """Wait for the next question and answer it."""
        asked = self.seen.count(QUESTION)
        while self.seen.count(QUESTION) == asked:
            assert self._read(), f"no question came: {self.seen.decode()}"
        os.write(self.master, f"{key}\n".encode())

    def end(self) -> int:
        while self._read():
            pass
        os.close(self.master)
        return self.process.wait(DEADLINE_S)

    def _read(self) -> bool:
        ready, _, _ = select.select([self.master], [], [], DEADLINE_S)
        assert ready, f"nothing more came: {self.seen.decode()}"
        try:
            piece = os.read(self.master, 65536)
        except OSError:  # the other end is closed
            return False
        self.seen += piece
        return bool(piece)


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package in which two files were changed and one was deleted."""
    monkeypatch.chdir(tmp_path)
    printed_by(app, "controller", "foo")
    root = tmp_path / "foo"
    (root / "package.xml").write_text("mine\n")
    (root / "setup.py").write_text("mine too\n")
    (root / "pyproject.toml").unlink()
    return root


@pytest.fixture
def dialogue(root: Path) -> Iterator[Dialogue]:
    """Run the same command again."""
    started = Dialogue(root.parent)
    yield started
    if started.process.poll() is None:
        started.process.kill()
        started.process.wait()


def test_one_is_kept_and_one_is_replaced(root: Path, dialogue: Dialogue) -> None:
    dialogue.answer("k")
    dialogue.answer("r")
    assert dialogue.end() == 0
    assert (root / "package.xml").read_text() == "mine\n"
    assert "console_scripts" in (root / "setup.py").read_text()
    assert (root / "pyproject.toml").is_file()
    assert b"keep      package.xml" in dialogue.seen
    assert b"replace   setup.py" in dialogue.seen


def test_the_diff_is_shown_and_the_question_repeated(root: Path, dialogue: Dialogue) -> None:
    dialogue.answer("d")
    dialogue.answer("what?")
    dialogue.answer("k")
    dialogue.answer("k")
    assert dialogue.end() == 0
    assert b"-mine\r\n+<?xml" in dialogue.seen
    assert b"expected k, r, d or q" in dialogue.seen


@pytest.mark.parametrize(
    ("key", "code"),
    [("q", 1), ("\x03", 130), ("\x04", 1)],
    ids=["quit", "ctrl-c", "ctrl-d"],
)
def test_quitting_changes_nothing(root: Path, dialogue: Dialogue, key: str, code: int) -> None:
    dialogue.answer("r")
    dialogue.answer(key)
    assert dialogue.end() == code
    assert (root / "package.xml").read_text() == "mine\n"
    assert not (root / "pyproject.toml").exists()
    assert b"Traceback" not in dialogue.seen


def test_files_that_cannot_be_replaced_are_skipped_in_questions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for stream in ("stdin", "stderr"):
        monkeypatch.setattr(f"sys.{stream}.isatty", lambda: True)
    file = RenderedFile(path=PurePosixPath("a"), content=b"")
    stuck = Decision(file=file, action=Action.CONFLICT, reason="it is a directory")
    assert resolve_conflicts((stuck,)) == (stuck,)
