"""Judge whether expected rates are kept, when the machine is able to keep them."""

import json
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from benchmarks.bare_timer import BareSecond
from benchmarks.stolen import DISTURBED_PERCENT

__all__ = ["Rates", "bare_timer_beside", "broken", "is_void"]

ROOT: Final = Path(__file__).resolve().parents[2]
LOOKED_BACK_S: Final = 4.0
"""A rate that was not kept for 2 s is broken, and nodes report it one second later."""
LEAST_KEPT: Final = 0.99
LEAST_IDLE_PERCENT: Final = 10.0
"""Idle time of all cores, below which the stack does not get the CPU time that it needs."""


@dataclass
class Rates:
    """The verdicts on rates so far."""

    judged: int = 0
    void: int = 0
    faults: list[str] = field(default_factory=list)

    def look(
        self, nodes: Iterable[Mapping[str, Any]], seconds: Sequence[BareSecond], at_s: float
    ) -> None:
        """Judge the current rates.

        Args:
            nodes: as `Stack.nodes` returns them.
            seconds: the latest measurements of a bare timer.
            at_s: the current time, for the faults [s].
        """
        if is_void(seconds):
            self.void += 1
            return
        self.judged += 1
        self.faults += [f"{at_s:.0f} s: {fault}" for fault in broken(nodes)]


def is_void(seconds: Sequence[BareSecond]) -> bool:
    """Whether the machine was unable to keep a rate in one of these seconds, or that is unknown."""
    return not seconds or any(
        one.kept < LEAST_KEPT
        or one.stolen_percent > DISTURBED_PERCENT
        or one.idle_percent < LEAST_IDLE_PERCENT
        for one in seconds
    )


def broken(nodes: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """The rates that nodes report as broken."""
    for node in nodes:
        for rate in node["rates"]:
            if rate["standing"] == "broken":
                measured, wanted = rate["measured_hz"], rate["expected_hz"]
                yield f"{node['node']} {rate['name']}: {measured:.0f} of {wanted:.0f} Hz"


class _Beside:
    """The latest seconds of a bare timer."""

    def __init__(self) -> None:
        self._seconds: deque[BareSecond] = deque(maxlen=10)

    def take(self, line: bytes) -> None:
        self._seconds.append(BareSecond(**json.loads(line)))

    def newest(self) -> tuple[BareSecond, ...]:
        since_s = time.monotonic() - LOOKED_BACK_S
        return tuple(second for second in self._seconds.copy() if second.at_s > since_s)


@contextmanager
def bare_timer_beside() -> Iterator[_Beside]:
    """Run a bare timer in its own process inside the `with` block."""
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.bare_timer"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=ROOT,
    )
    beside = _Beside()

    def read() -> None:
        assert process.stdout is not None
        for line in process.stdout:
            beside.take(line)

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    try:
        yield beside
    finally:
        assert process.stdin is not None
        process.stdin.close()
        reader.join()
        process.wait()
