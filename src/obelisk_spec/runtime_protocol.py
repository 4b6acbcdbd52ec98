"""Protocol between the tool and running nodes: rates, clock page, startup gate, pages.

Rates are keys and values of a `diagnostic_msgs/DiagnosticStatus`; no ROS message is imported.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

__all__ = [
    "ACTIVATION",
    "CLOCK_EPOCH",
    "CLOCK_FIRST_DUE",
    "CLOCK_PAGE",
    "CLOCK_TIME",
    "CLOCK_TOPIC",
    "CLOCK_VARIABLE",
    "DIAGNOSTICS_TOPIC",
    "FIRST_OUTPUT",
    "GATE_VARIABLE",
    "LOCAL_TRANSPORT_OFF",
    "LOCAL_TRANSPORT_VARIABLE",
    "REJECTION",
    "REPORT_PERIOD_S",
    "SOCKETS_FOLDER",
    "STANDINGS",
    "STEPS",
    "TOLERANCE",
    "USE_SIM_TIME",
    "ClockDescriptors",
    "Rate",
    "Standing",
    "clock_page_bytes",
    "hz",
    "parse_clock",
    "parse_rate",
    "parse_rejection",
    "parse_value",
    "rate_name",
    "rate_values",
    "rejection_text",
    "rejection_values",
]

USE_SIM_TIME: Final = "use_sim_time"
"""The ROS parameter that makes a node use simulated time."""

CLOCK_TOPIC: Final = "/clock"
"""The topic of simulated time, a `rosgraph_msgs/Clock`."""
CLOCK_VARIABLE: Final = "OBK_CLOCK"
"""The environment variable that passes the clock page of a launch to its processes.

Its value is `<page>,<own>,<wake>,<wake>,...`: the descriptor of the page, the index of the
process's own wake descriptor in the list, and the wake descriptors of all processes (eventfds).
Each process inherits all of them. So the page has no name in any folder and disappears with its
last user.
"""
CLOCK_PAGE: Final = "obk_clock"
"""Name of the clock page's memfd."""
CLOCK_TIME: Final = 0
"""Index of an 8-byte word in the clock page: the simulated time [ns]."""
CLOCK_EPOCH: Final = 1
"""Index of the number of times that the clock jumped back."""
CLOCK_FIRST_DUE: Final = 8
"""Index of the time at which to wake the first process [ns]; the others follow."""
_WORD_BYTES: Final = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockDescriptors:
    """The descriptors that a process of a launch inherits for simulated time."""

    page: int
    own: int
    """Index of the process in `wakes`."""
    wakes: tuple[int, ...]
    """One eventfd per process."""

    def __str__(self) -> str:
        return ",".join(map(str, (self.page, self.own, *self.wakes)))


def parse_clock(text: str) -> ClockDescriptors | None:
    """Parse a value of `CLOCK_VARIABLE`; None if it is invalid."""
    words = text.split(",")
    if not all(word.isdecimal() for word in words) or len(words) < 3:
        return None
    page, own, *wakes = map(int, words)
    return ClockDescriptors(page=page, own=own, wakes=tuple(wakes)) if own < len(wakes) else None


def clock_page_bytes(processes: int) -> int:
    """Size of the clock page for a number of processes [bytes]: a header, and a word for each."""
    return _WORD_BYTES * (CLOCK_FIRST_DUE + processes)


GATE_VARIABLE: Final = "OBK_GATE"
"""The environment variable with the path of the gate file for preloaded programs.

The launcher holds an exclusive lock (flock) on the file until no other stack uses its names and
its robot. A program creates its node once it gets a shared lock. The lock is released when the
launcher exits.
"""
LOCAL_TRANSPORT_VARIABLE: Final = "OBK_LOCAL_TRANSPORT"
"""The environment variable with the path of the folder for the local transport's sockets.

The launcher sets it. If it is `LOCAL_TRANSPORT_OFF`, all messages between processes are sent
through DDS. Users can set this value for the launcher, too.
"""
LOCAL_TRANSPORT_OFF: Final = "off"
SOCKETS_FOLDER: Final = "sockets"
"""The folder of the sockets, in the run's folder."""
DIAGNOSTICS_TOPIC: Final = "/diagnostics"
REPORT_PERIOD_S: Final = 1.0
TOLERANCE: Final = 0.1
"""Fraction of the expected rate by which the measured rate may be too low."""
STEPS: Final = "steps"
"""Name of the rate at which a simulator must step to keep up with the wall clock."""

Standing = Literal["kept", "off", "broken"]
STANDINGS: Final[tuple[Standing, ...]] = ("kept", "off", "broken")
"""Ordered by `DiagnosticStatus.level`: OK, WARN, ERROR."""

ACTIVATION: Final = "active_since_s"
"""Name of the status with the simulated time of a node's activation [s]."""
FIRST_OUTPUT: Final = "first_output_s"
"""Name of the status with the simulated time of the first message since the activation [s]."""

REJECTION: Final = "commands_rejected"
"""Name of the status of a robot that rejects all received commands."""
_SECONDS, _REASON = "seconds", "reason"

_EXPECTED, _MEASURED, _TICKS, _OVERRUNS = "expected_hz", "measured_hz", "ticks", "overruns"
_P50, _P99, _MAX, _PERIOD = "late_p50_us", "late_p99_us", "late_max_us", "period_sec"
_NODE_END: Final = ": "


@dataclass(frozen=True, slots=True, kw_only=True)
class Rate:
    """An expected rate of a node, and the measurement over the last second."""

    name: str
    """The timer's key, the absolute topic of a sensor group, or `steps`."""
    expected_hz: float
    measured_hz: float
    ticks: int
    """Number of ticks since the activation of the node; the same for `overruns`."""
    overruns: int
    """Ticks that were skipped or merged with the next one."""
    late_p50_us: float
    """Median lateness of the ticks [us]; likewise `late_p99_us` and `late_max_us`."""
    late_p99_us: float
    late_max_us: float
    standing: Standing = "kept"
    """`off`: more than 10 % below the expected rate; `broken`: for at least 2 s."""

    def __str__(self) -> str:
        return f"{self.name} runs at {hz(self.measured_hz)} of {hz(self.expected_hz)} Hz"


def hz(rate_hz: float) -> str:
    """A rate's number in Hz for people: four digits, but never with an exponent."""
    return f"{rate_hz:.0f}" if rate_hz >= 1000 else f"{rate_hz:.4g}"


def rate_values(rate: Rate) -> tuple[tuple[str, str], ...]:
    """Return keys and values of the status that reports a rate."""
    return (
        (_EXPECTED, f"{rate.expected_hz:.6g}"),
        (_MEASURED, f"{rate.measured_hz:.6g}"),
        (_TICKS, str(rate.ticks)),
        (_OVERRUNS, str(rate.overruns)),
        (_P50, f"{rate.late_p50_us:.1f}"),
        (_P99, f"{rate.late_p99_us:.1f}"),
        (_MAX, f"{rate.late_max_us:.1f}"),
        (_PERIOD, f"{1 / rate.expected_hz:.6g}"),
    )


def rate_name(node: str, name: str) -> str:
    """Format a status name: `/arm/controller`, `timer_ctrl` -> `arm/controller: timer_ctrl`."""
    return f"{node.lstrip('/')}{_NODE_END}{name}"


def parse_value(what: str, name: str, values: Mapping[str, str]) -> float | None:
    """Parse the measured value in a status; None if the status reports something else.

    Args:
        what: name of the value, such as `ACTIVATION`.
        name: name of the status, as formatted by `rate_name`.
        values: values of the status, by key.
    """
    if not name.endswith(f"{_NODE_END}{what}"):
        return None
    try:
        value = float(values[what])
    except (KeyError, ValueError):
        return None
    return value if math.isfinite(value) else None


def rejection_values(seconds: float, reason: str) -> tuple[tuple[str, str], ...]:
    """Return keys and values of the status `REJECTION`.

    Args:
        seconds: how long all commands have been rejected [s]; 0 if they are accepted again.
        reason: why the latest one was rejected.
    """
    return ((_SECONDS, f"{seconds:.1f}"), (_REASON, reason))


def rejection_text(node: str, seconds: float, reason: str) -> str:
    """Describe the fault of a robot that accepts no command until the end of its run.

    Args:
        node: its full name.
        seconds: how long all commands have been rejected [s].
        reason: why the latest one was rejected.
    """
    return f"{node} rejected every command for the last {seconds:.1f} s of the run: {reason}"


def parse_rejection(name: str, values: Mapping[str, str]) -> tuple[float, str] | None:
    """Parse the arguments of `rejection_values`; None if the status reports something else."""
    if not name.endswith(f"{_NODE_END}{REJECTION}"):
        return None
    try:
        return float(values[_SECONDS]), values[_REASON]
    except (KeyError, ValueError):
        return None


def parse_rate(name: str, level: int, values: Mapping[str, str]) -> Rate | None:
    """Parse the rate in a status; None if the status reports something else.

    Args:
        name: name of the status, as formatted by `rate_name`.
        level: 0 to 2.
        values: values of the status, by key.
    """
    _, found, own_name = name.partition(_NODE_END)
    if not found or level not in range(len(STANDINGS)):
        return None
    try:
        numbers = {key: float(values[key]) for key in (_EXPECTED, _MEASURED, _P50, _P99, _MAX)}
        rate = Rate(
            name=own_name,
            ticks=int(values[_TICKS]),
            overruns=int(values[_OVERRUNS]),
            standing=STANDINGS[level],
            **numbers,
        )
    except (KeyError, ValueError):
        return None
    return rate if all(map(math.isfinite, numbers.values())) and rate.expected_hz > 0 else None
