"""What processes take of this machine, in the interval between two looks."""

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final

import psutil

__all__ = ["OwnCost", "ProcessLoad", "ProcessLoads"]

_PERCENT: Final = 100.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessLoad:
    """One process."""

    cpu_percent: float
    """Of one core."""
    memory_bytes: int
    """Resident."""
    uptime_s: float


class ProcessLoads:
    """Looks at processes again and again."""

    def __init__(self) -> None:
        """Begin with none."""
        self._known: dict[int, psutil.Process] = {}

    def look(self, pids: Collection[int]) -> Mapping[int, ProcessLoad]:
        """What these take; those that are gone are left out.

        A process that was not looked at before counts from its start.
        """
        self._known = {pid: known for pid, known in self._known.items() if pid in pids}
        loads = {}
        for pid in pids:
            try:
                loads[pid] = self._load(pid)
            except psutil.Error:
                self._known.pop(pid, None)
        return loads

    def _load(self, pid: int) -> ProcessLoad:
        is_new = pid not in self._known
        process = self._known.setdefault(pid, psutil.Process(pid))
        with process.oneshot():
            uptime_s = max(time.time() - process.create_time(), 1e-3)
            measured = process.cpu_percent()
            times = process.cpu_times()
            since_start = _PERCENT * (times.user + times.system) / uptime_s
            return ProcessLoad(
                cpu_percent=since_start if is_new else measured,
                memory_bytes=process.memory_info().rss,
                uptime_s=uptime_s,
            )


class OwnCost:
    """What this process takes itself."""

    def __init__(self) -> None:
        """Begin the first interval."""
        self._cpu_s, self._wall_s = time.process_time(), time.monotonic()

    def percent(self) -> float:
        """Of one core, since the last call; the next interval begins."""
        cpu_s, wall_s = time.process_time(), time.monotonic()
        used, passed = cpu_s - self._cpu_s, max(wall_s - self._wall_s, 1e-6)
        self._cpu_s, self._wall_s = cpu_s, wall_s
        return _PERCENT * used / passed
