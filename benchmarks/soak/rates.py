"""Whether promised rates are kept, where the machine is able to keep any."""

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
"""A rate that was not kept for 2 s is broken, and reported a second later."""
LEAST_KEPT: Final = 0.99
LEAST_IDLE_PERCENT: Final = 10.0
"""Of all cores: with less, the stack does not get what it wants."""


@dataclass
class Rates:
    """How often rates were looked at."""

    judged: int = 0
    void: int = 0
    faults: list[str] = field(default_factory=list)

    def look(
        self, nodes: Iterable[Mapping[str, Any]], seconds: Sequence[BareSecond], at_s: float
    ) -> None:
        """Judge them at a moment.

        Args:
            nodes: as `Stack.nodes` returns them.
            seconds: what a bare timer has kept in the last of them.
            at_s: the moment, for the faults [s].
        """
        if is_void(seconds):
            self.void += 1
            return
        self.judged += 1
        self.faults += [f"{at_s:.0f} s: {fault}" for fault in broken(nodes)]


def is_void(seconds: Sequence[BareSecond]) -> bool:
    """Whether the machine could not have kept a rate in one of these seconds, or may not."""
    return not seconds or any(
        one.kept < LEAST_KEPT
        or one.stolen_percent > DISTURBED_PERCENT
        or one.idle_percent < LEAST_IDLE_PERCENT
        for one in seconds
    )


def broken(nodes: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """The promises that a node says it does not keep."""
    for node in nodes:
        for rate in node["rates"]:
            if rate["standing"] == "broken":
                measured, wanted = rate["measured_hz"], rate["expected_hz"]
                yield f"{node['node']} {rate['name']}: {measured:.0f} of {wanted:.0f} Hz"


class _Beside:
    """The newest seconds of a bare timer."""

    def __init__(self) -> None:
        self._seconds: deque[BareSecond] = deque(maxlen=10)

    def take(self, line: bytes) -> None:
        self._seconds.append(BareSecond(**json.loads(line)))

    def newest(self) -> tuple[BareSecond, ...]:
        since_s = time.monotonic() - LOOKED_BACK_S
        return tuple(second for second in self._seconds.copy() if second.at_s > since_s)


@contextmanager
def bare_timer_beside() -> Iterator[_Beside]:
    """A bare timer in a process of its own, for as long as this is entered."""
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
