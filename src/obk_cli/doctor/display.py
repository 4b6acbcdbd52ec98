"""Check `display`: whether the display that the environment names accepts connections.

Source: X(7), "Display names": `host:number.screen`, by a socket file here, else TCP port 6000 + n.
"""

import os
import re
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obk_cli.doctor.finding import Finding, note, ok

__all__ = ["DisplayFacts", "judge_display", "probe_display"]


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplayFacts:
    """What DISPLAY and WAYLAND_DISPLAY name, and whether anybody answers there."""

    names: tuple[str, ...]
    """Such as `DISPLAY=:0`; empty where neither is set."""
    fault: str
    """Why the first of them does not answer; empty: it does, or there is none."""
    is_ssh: bool


def judge_display(facts: DisplayFacts) -> Iterator[Finding]:
    """Whether a window can be opened."""
    if not facts.names:
        cure = "ssh -X ..." if facts.is_ssh else "export MUJOCO_GL=egl"
        yield note("no display is set: stacks run without windows", cure)
    elif facts.fault:
        yield note(
            f"{facts.names[0]} does not answer: {facts.fault}", "unset DISPLAY WAYLAND_DISPLAY"
        )
    else:
        yield ok(f"display {facts.names[0]} answers")


VARIABLES: Final = ("WAYLAND_DISPLAY", "DISPLAY")
ANSWER_S: Final = 1.0
_X: Final = re.compile(r"(?P<host>[^:]*):(?P<number>\d+)(?:\.\d+)?")
_X_FIRST_PORT: Final = 6000


def probe_display() -> DisplayFacts:
    """Connect to it."""
    named = [(name, value) for name in VARIABLES if (value := os.environ.get(name))]
    faults = [_wayland_fault(v) if n == VARIABLES[0] else _x_fault(v) for n, v in named]
    return DisplayFacts(
        names=tuple(f"{name}={value}" for name, value in named),
        fault=faults[0] if faults else "",
        is_ssh="SSH_CONNECTION" in os.environ,
    )


def _wayland_fault(value: str) -> str:
    return _connect_fault(str(Path(os.environ.get("XDG_RUNTIME_DIR", "/nowhere"), value)))


def _x_fault(value: str) -> str:
    display = _X.fullmatch(value)
    if display is None:
        return "not a display name such as :0"
    number = int(display["number"])
    if display["host"] in ("", "unix"):
        return _connect_fault(f"/tmp/.X11-unix/X{number}")  # noqa: S108 - X has it there
    return _connect_fault((display["host"], _X_FIRST_PORT + number))


def _connect_fault(address: str | tuple[str, int]) -> str:
    family = socket.AF_UNIX if isinstance(address, str) else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_STREAM) as connection:
            connection.settimeout(ANSWER_S)
            connection.connect(address)
    except OSError as fault:
        return fault.strerror or str(fault)
    return ""
