"""A fake terminal: the visible output of a program, and what has scrolled out."""

import codecs
import os
import re
import select
import termios
from typing import Final

from rich.cells import cell_len

DEADLINE_S: Final = 30.0
_END: Final = b"\0"
"""A marker after all output, because a terminal forwards it with a delay."""
_PIECE: Final = re.compile(r"\x1b\[(?P<number>[\d;]*)(?P<end>[@-~])|(?P<char>.)", re.DOTALL)


class Terminal:
    """A pseudo terminal and a minimal emulation of what a status area may use."""

    def __init__(self, width: int, height: int) -> None:
        self.master, self.slave = os.openpty()
        self.resize(width, height)
        self.rows: list[str] = [""]
        """All rows ever printed; the last `height` ones are visible."""
        self.row, self.column = 0, 0
        self.wrapped = 0
        self._decoder = codecs.getincrementaldecoder("utf-8")()
        self._begun = ""
        self._is_over = False

    def resize(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        termios.tcsetwinsize(self.slave, (height, width))

    def close(self) -> None:
        os.close(self.master)
        os.close(self.slave)

    def read(self) -> None:
        """Read the next output."""
        ready, _, _ = select.select([self.master], [], [], DEADLINE_S)
        assert ready, f"nothing more came; the last rows are: {self.rows[-5:]}"
        data = os.read(self.master, 1 << 16)
        self._is_over = data.endswith(_END)
        self.feed(self._decoder.decode(data.removesuffix(_END)))

    def read_until(self, text: str) -> None:
        """Read output until some text is visible."""
        while not any(text in row for row in self.rows):
            self.read()

    def read_the_rest(self) -> None:
        """Read all output so far."""
        os.write(self.slave, _END)
        while not self._is_over:
            self.read()

    def feed(self, text: str) -> None:
        text = self._begun + text
        begin = text.rfind("\x1b")
        is_begun = begin >= 0 and not _PIECE.match(text, begin)["end"]
        self._begun = text[begin:] if is_begun else ""
        for piece in _PIECE.finditer(text.removesuffix(self._begun)):
            if piece["char"] is None:
                self._control(piece["number"], piece["end"])
            else:
                self._character(piece["char"])

    def _control(self, number: str, end: str) -> None:
        assert end in "AJm", f"a sequence that outlasts a killed process, or is unknown: {end}"
        if end == "A":
            self.row = max(self.row - int(number), len(self.rows) - self.height, 0)
        elif end == "J":
            self.rows[self.row :] = [self.rows[self.row][: self.column]]

    def _character(self, char: str) -> None:
        if char == "\r":
            self.column = 0
        elif char == "\n":
            self._down()
        else:
            if self.column + cell_len(char) > self.width:
                self.wrapped += 1
                self._down()
                self.column = 0
            row = self.rows[self.row].ljust(self.column)
            self.rows[self.row] = row[: self.column] + char + row[self.column + 1 :]
            self.column += cell_len(char)

    def _down(self) -> None:
        self.row += 1
        if self.row == len(self.rows):
            self.rows.append("")
