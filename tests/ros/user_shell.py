"""A user at a terminal: a shell on a pseudo terminal, which types and reads like a person."""

import codecs
import os
import re
import select
import subprocess
import termios
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from obk_cli.terminal import plain

from .stack import patient

DEADLINE_S: Final = 240.0
"""Timeout for any command, including compilers, on a busy machine [s]."""
SIZE: Final = (50, 160)
"""Rows and columns, wide enough for the findings in a document."""
CTRL_C: Final = "\x03"
PROMPT: Final = re.compile(r"user\[(?P<code>\d+)\]> ")


class UserShell:
    """A shell that waits for input."""

    def __init__(self, folder: Path, variables: Mapping[str, str]) -> None:
        self._master, slave = os.openpty()
        termios.tcsetwinsize(slave, SIZE)
        self._shell = subprocess.Popen(
            # The terminal must be the session's controlling terminal, to turn Ctrl-C into a signal.
            ["setsid", "--ctty", "bash", "--norc", "--noprofile", "--noediting", "-i"],
            cwd=folder,
            env={**variables, "PS1": "user[$?]> ", "TERM": "xterm-256color", "HISTFILE": ""},
            stdin=slave,
            stdout=slave,
            stderr=slave,
        )
        os.close(slave)
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._text = ""
        self.wait_for_prompt()

    def type(self, keys: str) -> None:
        """Press keys; ignores earlier output from now on."""
        self._text = ""
        os.write(self._master, keys.encode())

    def enter(self, line: str) -> None:
        """Type a command line; launches get limits that a busy machine can keep."""
        self.type(re.sub(r"^obk launch\b", " ".join(["obk", *patient("launch")]), line) + "\n")

    def press_ctrl_c(self) -> None:
        """Press Ctrl-C, and keep the earlier output."""
        os.write(self._master, CTRL_C.encode())

    def wait_for(self, pattern: re.Pattern[str]) -> re.Match[str]:
        """Read until some text is shown."""
        end = time.monotonic() + DEADLINE_S
        while not (found := pattern.search(self.seen)):
            assert time.monotonic() < end, f"never came: {pattern.pattern}\n{self.seen}"
            assert self._shell.poll() is None, f"the shell has ended\n{self.seen}"
            if select.select([self._master], [], [], 0.1)[0]:
                self._text += self._decoder.decode(os.read(self._master, 1 << 16))
        return found

    def wait_for_prompt(self) -> int:
        """Read until the shell waits again; return the exit code of the command."""
        return int(self.wait_for(PROMPT)["code"])

    @property
    def seen(self) -> str:
        """The output since the last input, without colors and cursor movements."""
        return "\n".join(plain(line) for line in self._text.split("\n"))

    def close(self) -> None:
        """Exit the shell."""
        os.close(self._master)
        try:
            self._shell.wait(DEADLINE_S)
        finally:
            self._shell.kill()
            self._shell.wait()


@contextmanager
def user_shell(folder: Path, variables: Mapping[str, str]) -> Iterator[UserShell]:
    """A shell in a folder; closed at the end, like a terminal window."""
    shell = UserShell(folder, variables)
    try:
        yield shell
    finally:
        shell.close()
