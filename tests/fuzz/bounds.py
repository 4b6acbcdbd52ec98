"""Run a test within bounds of exceptions, time and memory."""

import resource
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from hypothesis.errors import HypothesisException

__all__ = ["LONGEST_S", "MOST_BYTES", "Bounded", "bound_memory"]

LONGEST_S: Final = 2.0
"""CPU time that one input may take [s]."""
MOST_BYTES: Final = 500_000_000
"""Memory by which the process may grow."""
MOST_FINDINGS: Final = 20
OURS: Final = ("/src/obk", "/src/obelisk")


@dataclass(slots=True)
class Bounded:
    """A test that records findings instead of failing."""

    test: Callable[..., Any]
    executions: int = 0
    slowest_s: float = 0.0
    findings: dict[str, str] = field(default_factory=dict)
    """Location of a finding -> its description, with the input if it is short."""

    def __call__(self, *arguments: Any, **options: Any) -> None:
        """Run one input."""
        self.executions += 1
        begin = time.process_time()
        try:
            self.test(*arguments, **options)
        except HypothesisException:
            raise  # how a test rejects an input
        except Exception as error:
            self._note(_place(error), f"{type(error).__name__}: {error}", options)
        took_s = time.process_time() - begin
        self.slowest_s = max(self.slowest_s, took_s)
        if took_s > LONGEST_S:
            self._note("time", f"{took_s:.1f} s", options)

    def _note(self, where: str, what: str, options: dict[str, Any]) -> None:
        if len(self.findings) < MOST_FINDINGS:
            self.findings.setdefault(where, f"{what}; input {options!r}"[:1000])


def bound_memory() -> None:
    """Limit the memory: more than `MOST_BYTES` from now on raises a MemoryError."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    used = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmData"))
    most = used * 1024 + MOST_BYTES
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def _place(error: Exception) -> str:
    """The innermost line of the project's code."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if any(part in frame.filename for part in OURS)]
    frame = (ours or frames)[-1]
    return f"{Path(frame.filename).name}:{frame.lineno}"
