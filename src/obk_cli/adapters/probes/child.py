"""A program tried in a process of its own: a crash or a hang there costs this process nothing."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

from obk_cli.doctor.trial import Trial

__all__ = ["python_command", "told_in_json", "try_program"]


def python_command(module: str, *arguments: str) -> tuple[str, ...]:
    """How a module of ours is run: nothing in the working folder can take the place of another."""
    return (sys.executable, "-P", "-m", module, *arguments)


def try_program(
    command: Sequence[str], *, timeout_s: float, variables: Mapping[str, str] | None = None
) -> Trial:
    """Run a program to its end, or kill it.

    Args:
        command: the program and its arguments.
        timeout_s: how long it may take [s].
        variables: all of its environment; None: that of this process.
    """
    begin = time.monotonic()
    try:
        ended = subprocess.run(
            command,
            capture_output=True,
            check=False,
            env=variables,
            errors="replace",
            stdin=subprocess.DEVNULL,
            text=True,
            timeout=timeout_s,
        )
    except subprocess.TimeoutExpired as late:
        said = late.stdout.decode(errors="replace") if isinstance(late.stdout, bytes) else ""
        return Trial(end="timed out", said=said, complaint="", seconds=timeout_s)
    except OSError as fault:
        return Trial(end="failed", said="", complaint=str(fault), seconds=0.0)
    seconds = time.monotonic() - begin
    complaint = _last_line(ended.stderr)
    if ended.returncode < 0:
        name = signal.Signals(-ended.returncode).name
        return Trial(
            end="crashed", said=ended.stdout, complaint=complaint, signal=name, seconds=seconds
        )
    return Trial(
        end="failed" if ended.returncode else "done",
        said=ended.stdout,
        complaint=complaint,
        seconds=seconds,
    )


def told_in_json(trial: Trial) -> dict[str, Any]:
    """The JSON objects that a program printed, a line each, as one; libraries print there too."""
    told: dict[str, Any] = {}
    for line in trial.said.splitlines():
        if line.startswith("{"):
            told |= json.loads(line)
    return told


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else ""
