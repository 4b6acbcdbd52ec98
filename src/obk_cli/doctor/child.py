"""Run a program in its own process, where a crash or a hang does not affect this one."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

__all__ = ["Trial", "child_command", "json_output", "try_program"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """How a program in its own process ended."""

    end: Literal["done", "failed", "crashed", "timed out"]
    stdout: str
    last_error: str
    """The last line of its standard error; empty if there is none."""
    signal: str = ""
    """The signal that killed it, if it crashed."""
    seconds: float
    """Duration [s]."""

    @property
    def outcome(self) -> str:
        """How it ended, as a predicate for a sentence with its name."""
        match self.end:
            case "done":
                return "worked"
            case "timed out":
                return f"did not finish within {self.seconds:.0f} s"
            case "crashed":
                return f"was killed by {self.signal}"
            case "failed":
                return f"failed: {self.last_error or 'no output on stderr'}"


def child_command(program: str, *arguments: str) -> tuple[str, ...]:
    """The command for a program in `child_programs`; ignores modules in the working folder."""
    return (sys.executable, "-P", "-m", "obk_cli.doctor.child_programs", program, *arguments)


def try_program(
    command: Sequence[str], *, timeout_s: float, variables: Mapping[str, str] | None = None
) -> Trial:
    """Run a program until it ends, or kill it at the timeout.

    Args:
        command: the program and its arguments.
        timeout_s: time limit [s].
        variables: its complete environment; None: that of this process.
    """
    start = time.monotonic()
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
        stdout = late.stdout.decode(errors="replace") if isinstance(late.stdout, bytes) else ""
        return Trial(end="timed out", stdout=stdout, last_error="", seconds=timeout_s)
    except OSError as fault:
        return Trial(end="failed", stdout="", last_error=str(fault), seconds=0.0)
    seconds = time.monotonic() - start
    last_error = _last_line(ended.stderr)
    if ended.returncode < 0:
        name = signal.Signals(-ended.returncode).name
        return Trial(
            end="crashed", stdout=ended.stdout, last_error=last_error, signal=name, seconds=seconds
        )
    return Trial(
        end="failed" if ended.returncode else "done",
        stdout=ended.stdout,
        last_error=last_error,
        seconds=seconds,
    )


def json_output(trial: Trial) -> dict[str, Any]:
    """Merge the JSON objects that a program printed, one per line; ignore other output."""
    merged: dict[str, Any] = {}
    for line in trial.stdout.splitlines():
        if line.startswith("{"):
            merged |= json.loads(line)
    return merged


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else ""
