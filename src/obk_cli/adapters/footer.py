"""A status area below a terminal's lines: takes lines, gives the text that puts them above it.

Uses nothing that would outlast a killed process: no hidden cursor, no second screen, no scroll
region. Never writes itself.
"""

import os
from collections.abc import Callable, Sequence
from typing import Final

__all__ = ["Draw", "Footer", "takes_footer"]

Draw = Callable[[int, int], Sequence[str]]
"""Columns and rows of the terminal -> lines that fit; colours allowed, nothing else."""

_USUAL_SIZE: Final = os.terminal_size((80, 24))


def takes_footer(fd: int, term: str) -> bool:
    """Whether a descriptor is a terminal that can move its cursor; `term` is the variable TERM."""
    return term not in ("", "dumb") and os.isatty(fd)


class Footer:
    """What stands at the bottom of a terminal, with the cursor in the line below it."""

    def __init__(self, fd: int, draw: Draw) -> None:
        """Ask `draw` for the lines with every text, for the size that `fd` has by then."""
        self._fd = fd
        self._draw = draw
        self._shown: tuple[str, ...] = ()

    def below(self, log: str) -> str:
        """The text to write so that `log`, whole lines, comes above; empty: nothing changed.

        Raises:
            OSError: the terminal is gone.
        """
        size = self._terminal_size()
        lines = tuple(self._draw(*size))[: max(0, size.lines - 1)]
        if not log and lines == self._shown:
            return ""
        erased = self._erased(size.columns)
        self._shown = lines
        return erased + log + "".join(f"{line}\n" for line in lines)

    def removed(self) -> str:
        """The text to write so that nothing is left of it."""
        erased = self._erased(self._terminal_size().columns)
        self._shown = ()
        return erased

    def _terminal_size(self) -> os.terminal_size:
        size = os.get_terminal_size(self._fd)
        return size if size.columns and size.lines else _USUAL_SIZE

    def _erased(self, columns: int) -> str:
        """Back to where the area began; one made narrower since has wrapped the lines."""
        from rich.text import Text  # slow, and not needed without a terminal

        cells = (Text.from_ansi(line).cell_len for line in self._shown)
        rows = sum(max(1, -(-count // columns)) for count in cells)
        return f"\r\x1b[{rows}A\x1b[J" if rows else ""
