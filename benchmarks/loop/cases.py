"""Define the contestants, layouts and parts of the suite. Data only."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

__all__ = [
    "BASELINE",
    "CONTESTANTS",
    "CURVE",
    "FLOOR",
    "LAYOUTS",
    "LIBRARY",
    "PARTS",
    "ROLES",
    "WORK",
    "Case",
    "Effort",
    "cases_of",
    "effort_of",
]

ROLES = ("sim", "est", "ctrl")
LAYOUTS = ("separate", "composed")
"""One process per node, or all nodes in one process."""
BASELINE = "rclpy SingleThreadedExecutor"
LIBRARY = "obelisk nodes"
"""The library's base classes, run by `spin_obelisk`, or composed as by `obk launch`."""
FLOOR = "C on rcl"
CONTESTANTS = (
    BASELINE,
    "rclpy MultiThreadedExecutor",
    "rclpy EventsExecutor",
    "obelisk executor",
    LIBRARY,
    FLOOR,
)
IN_CURVES = frozenset({BASELINE, LIBRARY, FLOOR})
WITHOUT_BASELINE = "nodes"
"""A curve without the baseline, thirty processes of which take too long to start."""
PARTS = ("work", "nodes", "rate", "size")


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One way to run sim -> est -> ctrl -> sim."""

    contestant: str
    layout: str
    rate_hz: int = 1000
    """The rate of each node's timer."""
    joints: int = 30
    nodes: int = 3
    """A multiple of three; every three nodes form a loop."""

    def __str__(self) -> str:
        return (
            f"{self.contestant}, {self.layout}, {self.nodes} nodes, {self.rate_hz} Hz, "
            f"{self.joints} joints"
        )

    @property
    def processes(self) -> tuple[tuple[str, ...], ...]:
        """The node names of each process: `sim_0` is the simulator of the first loop."""
        loops = range(self.nodes // len(ROLES))
        names = tuple(f"{role}_{loop}" for loop in loops for role in ROLES)
        return tuple((name,) for name in names) if self.layout == "separate" else (names,)

    @property
    def baseline(self) -> "Case":
        """The same case with the baseline executor of all ratios."""
        return Case(**{**self.as_dict(), "contestant": BASELINE})

    def as_dict(self) -> dict[str, Any]:
        """The fields by name."""
        return asdict(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """The number and duration of the runs of a case."""

    rounds: int
    seconds: float
    """The duration of each run."""


WORK = Effort(rounds=9, seconds=3.0)
PEER = Effort(rounds=2, seconds=3.0)
CURVE = Effort(rounds=2, seconds=2.0)


def effort_of(case: Case) -> Effort:
    """The effort for a case: highest for `work` if a goal depends on it, lower for curves."""
    if case != Case(contestant=case.contestant, layout=case.layout):
        return CURVE
    return WORK if case.contestant in IN_CURVES else PEER


POINTS: dict[str, tuple[dict[str, int], ...]] = {
    "work": ({},),
    "nodes": tuple({"nodes": nodes, "rate_hz": 100} for nodes in (3, 30)),
    "rate": tuple({"rate_hz": rate_hz} for rate_hz in (500, 1000, 2000)),
    "size": tuple({"joints": joints} for joints in (10, 30, 300)),
}
"""The values that each part varies, in addition to contestants and layouts."""


def cases_of(
    parts: Iterable[str], contestants: Iterable[str], layouts: Iterable[str]
) -> tuple[Case, ...]:
    """The cases of some parts of the suite, without duplicates."""
    chosen, laid_out = tuple(contestants), tuple(layouts)
    return tuple(
        dict.fromkeys(
            Case(contestant=contestant, layout=layout, **point)
            for part in parts
            for point in POINTS[part]
            for layout in laid_out
            for contestant in chosen
            if part == "work" or contestant in IN_CURVES
            if part != WITHOUT_BASELINE or contestant != BASELINE
        )
    )
