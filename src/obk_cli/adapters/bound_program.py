"""Becomes another program, which gets SIGTERM when the process that started this one ends.

Run as a program of its own: `python -I -S bound_program.py PARENT PROGRAM ARGUMENTS...`, with the
number of that process. Done here, not between fork and exec of the starter, which has threads.
Imports the standard library only, so that it is up at once. Source: prctl(2), PR_SET_PDEATHSIG.
"""

import ctypes
import os
import signal
import sys

__all__ = ["main"]

PR_SET_PDEATHSIG = 1


def main(parent: int, *command: str) -> None:
    """Become the program of a command; end at once where the parent is gone already."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        sys.exit(1)
    os.execvp(command[0], command)  # noqa: S606 - without a shell, as asked


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
