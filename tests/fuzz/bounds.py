"""A test within bounds: what an input raises, how long it takes, what memory it wants."""

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
"""Of processor time that one input may take [s]."""
MOST_BYTES: Final = 500_000_000
"""By which the process may grow."""
MOST_FINDINGS: Final = 20
OURS: Final = ("/src/obk", "/src/obelisk")


@dataclass(slots=True)
class Bounded:
    """A test that takes note of findings in place of failing."""

    test: Callable[..., Any]
    executions: int = 0
    slowest_s: float = 0.0
    findings: dict[str, str] = field(default_factory=dict)
    """Where it came from -> what it was, with the input as far as it is short."""

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
    """From here on, more memory than `MOST_BYTES` is a MemoryError."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    used = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmData"))
    most = used * 1024 + MOST_BYTES
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def _place(error: Exception) -> str:
    """The innermost line of ours."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if any(part in frame.filename for part in OURS)]
    frame = (ours or frames)[-1]
    return f"{Path(frame.filename).name}:{frame.lineno}"
