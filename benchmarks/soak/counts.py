"""Measure the resources of a stack's processes, and judge whether they grow."""

import math
import statistics
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import psutil

__all__ = [
    "LEAST_MB",
    "Growth",
    "growth",
    "mapped_files",
    "of_process",
    "shared_files",
    "verdicts",
]

SHARED_MEMORY: Final = Path("/dev/shm")
OF_DDS: Final = ("fastrtps", "sem.fastrtps")
"""Name prefixes of its segments and ports; other files are shared by the whole machine."""
WARM_PART: Final = 0.3
"""Fraction of a process's samples that are not judged, because caches are still filling."""
LEAST_JUDGED_S: Final = 60.0
"""Processes with a shorter life are not judged, because they are still growing normally."""
TOLERANCES: Final = {"rss_mb": 0.05, "pss_mb": 0.05}
"""Growth over the judged time that counts as flat, relative to the mean; 0 for other counts."""
LEAST_MB: Final = 3.0
LEAST: Final = {
    "rss_mb": LEAST_MB,
    "pss_mb": LEAST_MB,
    "handles": 2.0,
    "threads": 1.0,
    "sockets": 2.0,
    "shm_files": 3.0,
}
"""Growth that always counts as flat."""
NOISES: Final = 2.0
"""Growth must exceed the allowed growth by this number of standard errors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Growth:
    """Growth over some time, by linear regression."""

    grown: float
    noise: float
    """The standard error of the growth."""


def of_process(pid: int) -> dict[str, float]:
    """The resources of a process; empty if it has ended."""
    try:
        process = psutil.Process(pid)
        memory = process.memory_full_info()
        links = [str(path.readlink()) for path in Path(f"/proc/{pid}/fd").iterdir()]
        threads = process.num_threads()
    except (psutil.Error, OSError):
        return {}
    return {
        "rss_mb": memory.rss / 1e6,
        "pss_mb": memory.pss / 1e6,
        "handles": len(links),
        "sockets": sum(link.startswith("socket:") for link in links),
        "threads": threads,
    }


def shared_files() -> set[str]:
    """The files of DDS in shared memory, of all processes."""
    return {path.name for path in SHARED_MEMORY.iterdir() if path.name.startswith(OF_DDS)}


def mapped_files(pid: int) -> set[str]:
    """The files of DDS in shared memory that a process has mapped."""
    try:
        lines = Path(f"/proc/{pid}/maps").read_text(encoding="utf-8").splitlines()
    except OSError:  # the process has ended
        return set()
    paths = (Path(line.split(maxsplit=5)[5]) for line in lines if str(SHARED_MEMORY) in line)
    return {path.name for path in paths if path.name.startswith(OF_DDS)}


def growth(times: Sequence[float], values: Sequence[float]) -> Growth:
    """The growth of values over time; zero if there are fewer than three different times."""
    if len(set(times)) < 3:
        return Growth(grown=0.0, noise=0.0)
    slope, level = statistics.linear_regression(times, values)
    rest = sum((v - level - slope * t) ** 2 for t, v in zip(times, values, strict=True))
    mean = statistics.fmean(times)
    spread = sum((t - mean) ** 2 for t in times)
    seconds = times[-1] - times[0]
    return Growth(
        grown=slope * seconds, noise=math.sqrt(rest / (len(times) - 2) / spread) * seconds
    )


def verdicts(
    samples: Iterable[Mapping[str, Any]],
    least_judged_s: float = LEAST_JUDGED_S,
    least_mb: float = LEAST_MB,
) -> list[dict[str, Any]]:
    """Judge for each process that lived long enough whether each count is flat.

    Args:
        samples: with `time_s` [s], `who`, `pid` and counts.
        least_judged_s: processes observed for a shorter time are skipped [s].
        least_mb: growth of memory that always counts as flat [MB].
    """
    least = {**LEAST, "rss_mb": least_mb, "pss_mb": least_mb}
    by_process: defaultdict[tuple[str, int], list[Mapping[str, Any]]] = defaultdict(list)
    for one in samples:
        by_process[one["who"], one["pid"]].append(one)
    found = []
    for (who, pid), own in by_process.items():
        judged = own[int(WARM_PART * len(own)) :]
        times = [one["time_s"] for one in judged]
        if times[-1] - times[0] < least_judged_s:
            continue
        for key in least:
            if key not in judged[0]:
                continue
            values = [one[key] for one in judged]
            seen = growth(times, values)
            mean = statistics.fmean(values)
            allowed = max(least[key], TOLERANCES.get(key, 0.0) * mean)
            found.append(
                {
                    "who": who,
                    "pid": pid,
                    "count": key,
                    "samples": len(values),
                    "seconds": round(times[-1] - times[0]),
                    "mean": round(mean, 2),
                    "grown": round(seen.grown, 2),
                    "noise": round(seen.noise, 2),
                    "allowed": round(allowed, 2),
                    "is_flat": seen.grown - NOISES * seen.noise <= allowed,
                }
            )
    return found
