"""The display that the environment names, and whether anybody answers there.

Source: X(7), "Display names": `host:number.screen`, by a socket file here, else TCP port 6000 + n.
"""

import os
import re
import socket
from pathlib import Path
from typing import Final

from obk_cli.doctor.display import DisplayFacts

__all__ = ["probe_display"]

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
        return "it is no display's name, such as :0"
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
