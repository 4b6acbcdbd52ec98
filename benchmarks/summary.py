"""The newest results held against their goals.

    python -m benchmarks.summary

Reads `benchmarks/results/*.json`, as many as there are, writes `goals.md` beside them, and the
loop's figures next to those of rclpy's executors into the project's README.
"""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.loop.cases import LIBRARY
from benchmarks.readme import peers_table, with_table
from benchmarks.stolen import DISTURBED_PERCENT

__all__ = ["Goal", "goals_table", "main", "notes", "slowest_look"]

ROOT: Final = Path(__file__).resolve().parents[1]
RESULTS: Final = ROOT / "benchmarks" / "results"
README: Final = ROOT / "README.md"
OF_MESSAGES: Final = ("topic echo", "topic hz", "topic delay", "topic pub", "service call")
"""Commands that start a ROS participant of their own."""
WORK: Final = {"rate_hz": 1000, "joints": 30, "nodes": 3}

Results = Mapping[str, Any]
"""What the JSON files hold, by their names without the ending."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """One figure and what it should be."""

    what: str
    least: float | None = None
    most: float | None = None
    unit: str = ""
    figure: Callable[[Results], float]

    @property
    def words(self) -> str:
        """`at most 0.33`, `from 0.8 to 1.2`."""
        if self.least is not None and self.most is not None:
            return f"{self.least:g} to {self.most:g}{self.unit}"
        sign, limit = ("≤", self.most) if self.least is None else ("≥", self.least)
        return f"{sign} {limit:g}{self.unit}"

    def is_met_by(self, value: float) -> bool:
        """Whether a value is as it should be."""
        return (self.least is None or value >= self.least) and (
            self.most is None or value <= self.most
        )


def loop(results: Results, layout: str, **point: int) -> Mapping[str, Any]:
    """The library's row of the loop's suite at one point."""
    wanted = {"contestant": LIBRARY, "layout": layout, **WORK, **point}
    rows: list[Mapping[str, Any]] = results["loop"]["cases"]
    found = next((row for row in rows if row["case"] == wanted and row["runs"]), None)
    if found is None:
        raise KeyError(f"{wanted} was not measured")
    return found


def ratio(layout: str, name: str) -> Callable[[Results], float]:
    """A median ratio to rclpy's executor, of the work."""
    return lambda results: float(loop(results, layout)["ratios"][name]["median"])


def kept(layout: str, rate_hz: int) -> Callable[[Results], float]:
    """The share of its rate that the slowest node kept, in the worst round, in %."""
    return lambda results: (
        100 * float(loop(results, layout, rate_hz=rate_hz)["figures"]["rate_hz"]["min"]) / rate_hz
    )


def per_node(layout: str) -> Callable[[Results], float]:
    """What a node of 30 costs over what one of 3 does, at 100 Hz."""

    def each(results: Results, nodes: int) -> float:
        row = loop(results, layout, rate_hz=100, nodes=nodes)
        return float(row["figures"]["cpu_per_tick_us"]["median"])

    return lambda results: each(results, 30) / each(results, 3)


def watched(layout: str) -> Callable[[Results], float]:
    """The least share of a promised rate while the stack is watched, in %."""
    return lambda results: 100 * float(results["watched"]["least_kept"][f"{layout}, watched"])


def slowest_look(
    commands: Mapping[str, Mapping[str, float]], *, has_messages: bool = False
) -> float:
    """The longest median of a command, without the `--duration` that it measures for [s].

    Args:
        commands: what each took, by its words.
        has_messages: of the commands that send or receive messages; otherwise of the others.

    Raises:
        KeyError: no such command was measured.
    """
    seconds = [
        took["median_s"] - float(words.partition("--duration ")[2] or 0.0)
        for words, took in commands.items()
        if words not in ("lifecycle get", "completion", "topic echo --help")
        and words.startswith(OF_MESSAGES) is has_messages
    ]
    if not seconds:
        raise KeyError("looking")
    return max(seconds)


def at(*path: str) -> Callable[[Results], float]:
    """A number in the results."""

    def find(results: Results) -> float:
        found: Any = results
        for name in path:
            found = found[name]
        return float(found)

    return find


LOCKSTEP: Final = (
    (
        "lock-step run of the dummy, everything recorded",
        14,
        " x real time",
        ("factors", "dummy", "best"),
    ),
    ("the same, of the arm", 9, " x real time", ("factors", "arm", "best")),
    ("the same, of the quadruped", 4.5, " x real time", ("factors", "quadruped", "best")),
    ("the same, of 31 nodes at 1 kHz", 1.9, " x real time", ("factors", "many", "best")),
    ("5 s trials of the dummy per minute", 130, "", ("trials", "dummy", "per_minute")),
    ("the same, of the arm", 90, "", ("trials", "arm", "per_minute")),
    ("the same, of the quadruped", 48, "", ("trials", "quadruped", "per_minute")),
)
"""What is measured of lock-step runs, at least how much, its unit, and its place in the results."""

GOALS: Final = (
    Goal(
        what="CPU of three nodes at 1 kHz, a process each, to rclpy's SingleThreadedExecutor",
        most=0.33,
        figure=ratio("separate", "cpu_percent"),
    ),
    Goal(
        what="the same, composed in one process", most=0.12, figure=ratio("composed", "cpu_percent")
    ),
    Goal(
        what="lateness of ticks p99, a process each, to the same",
        most=0.15,
        figure=ratio("separate", "late_p99_us"),
    ),
    Goal(
        what="1 kHz kept by the slowest node, a process each",
        least=99.8,
        unit=" %",
        figure=kept("separate", 1000),
    ),
    Goal(what="the same, composed", least=99.8, unit=" %", figure=kept("composed", 1000)),
    Goal(
        what="rates kept by the dummy stack while `obk monitor` watches and services are called",
        least=99.8,
        unit=" %",
        figure=watched("separate"),
    ),
    Goal(what="the same, composed", least=99.8, unit=" %", figure=watched("composed")),
    Goal(
        what="the slowest rate watched to the slowest of the stack alone, a process each",
        least=0.998,
        figure=at("watched", "watched_to_alone", "separate"),
    ),
    Goal(
        what="the same, composed",
        least=0.998,
        figure=at("watched", "watched_to_alone", "composed"),
    ),
    Goal(what="2 kHz kept, composed", least=99.8, unit=" %", figure=kept("composed", 2000)),
    Goal(
        what="CPU of a node's tick, 30 nodes to 3, a process each",
        most=1.2,
        figure=per_node("separate"),
    ),
    Goal(what="the same, composed", most=1.2, figure=per_node("composed")),
    Goal(
        what="the simulator's loop to bare `mj_step`, no sensors",
        most=1.1,
        figure=at("simulator", "cost", "no_sensors_over_mj_step"),
    ),
    Goal(
        what="the same, three groups heard at every step",
        most=1.25,
        figure=at("simulator", "cost", "three_groups_heard_over_mj_step"),
    ),
    Goal(
        what="real-time factor over 60 s",
        least=0.998,
        most=1.002,
        figure=at("simulator", "realtime", "realtime_factor"),
    ),
    Goal(
        what="lateness of steps p99",
        most=300,
        unit=" µs",
        figure=at("simulator", "realtime", "late_us", "p99"),
    ),
    Goal(
        what="CPU at real time to that of the work alone",
        most=1.3,
        figure=at("simulator", "realtime", "cpu_over_the_work_alone"),
    ),
    Goal(
        what="publishing `ObkJointEncoders` of 30 joints",
        most=40,
        unit=" µs",
        figure=at("simulator", "cost", "encoders_of_30_joints_heard_us", "median"),
    ),
    Goal(
        what="`obk --help`",
        most=0.15,
        unit=" s",
        figure=at("tool", "runs", "obk --help", "median_s"),
    ),
    Goal(
        what="`obk validate` of the dummy with its model",
        most=0.35,
        unit=" s",
        figure=at("tool", "runs", "obk validate dummy", "median_s"),
    ),
    Goal(
        what="the same to `check-jsonschema`",
        most=1.0,
        figure=at("tool", "obk over check-jsonschema", "dummy"),
    ),
    Goal(
        what="`obk validate` of 1,000 nodes",
        most=2.0,
        unit=" s",
        figure=at("tool", "runs", "obk validate big", "median_s"),
    ),
    Goal(
        what="`obk lifecycle get` on a running stack",
        most=0.3,
        unit=" s",
        figure=at("looking", "commands", "lifecycle get", "median_s"),
    ),
    Goal(
        what="the slowest of `obk topic list` and `info`, `node`, `param`, `service list`",
        most=0.5,
        unit=" s",
        figure=lambda results: slowest_look(results["looking"]["commands"], has_messages=False),
    ),
    Goal(
        what="the slowest of `obk topic echo`, `hz`, `delay`, `pub` and `service call`",
        most=1.0,
        unit=" s",
        figure=lambda results: slowest_look(results["looking"]["commands"], has_messages=True),
    ),
    Goal(
        what="`obk launch` of the dummy to all active",
        most=1.5,
        unit=" s",
        figure=at("launches", "up_s", "median"),
    ),
    Goal(what="its end", most=1.0, unit=" s", figure=at("launches", "down_s", "median")),
    *(
        Goal(what=what, least=least, unit=unit, figure=at("lockstep", *path))
        for what, least, unit, path in LOCKSTEP
    ),
    Goal(
        what="start of a further trial",
        most=60,
        unit=" ms",
        figure=at("lockstep", "start", "further_ms"),
    ),
    Goal(
        what="memory of 200 trials of the arm",
        most=220,
        unit=" MB",
        figure=at("lockstep", "memory", "most_mb"),
    ),
)


def goals_table(goals: Iterable[Goal], results: Results) -> Iterator[str]:
    """The lines of a Markdown table."""
    yield "| | goal | measured | |"
    yield "|---|---|---|---|"
    for goal in goals:
        try:
            value = goal.figure(results)
        except KeyError:
            yield f"| {goal.what} | {goal.words} | | not measured |"
            continue
        met = "met" if goal.is_met_by(value) else "**not met**"
        yield f"| {goal.what} | {goal.words} | {_three_digits(value)}{goal.unit} | {met} |"


def _three_digits(value: float) -> str:
    """At least three that count, and no powers of ten."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def notes(results: Results) -> Iterator[str]:
    """Which of the results the machine's host, or other work, had a part in."""
    for name, found in sorted(results.items()):
        if (stolen := _stolen_percent(found)) > DISTURBED_PERCENT:
            yield f"{name}: up to {stolen:.0f} % of a core was stolen by the machine's host"
        if isinstance(found, dict) and found.get("is_quiet") is False:
            yield f"{name}: the machine was not quiet before every round"


def _stolen_percent(found: Any) -> float:
    """The most that is told anywhere within a result [% of a core]."""
    if isinstance(found, list):
        return max(map(_stolen_percent, found), default=0.0)
    if not isinstance(found, dict):
        return 0.0
    own = found.get("stolen_percent", 0.0)
    inner = max(map(_stolen_percent, found.values()), default=0.0)
    return max(inner, own if isinstance(own, int | float) else 0.0)


def read_results() -> Results:
    """All of them."""
    return {
        path.stem: json.loads(path.read_text(encoding="utf-8")) for path in RESULTS.glob("*.json")
    }


def main() -> int:
    """Write the tables."""
    results = read_results()
    lines = ["# The newest figures, held against their goals", "", *goals_table(GOALS, results), ""]
    told = [f"- {note}" for note in notes(results)]
    text = "\n".join([*lines, *told, ""] if told else lines)
    (RESULTS / "goals.md").write_text(text, encoding="utf-8")
    if "loop" in results:
        peers = "\n".join(peers_table(results["loop"]))
        document = with_table(README.read_text(encoding="utf-8"), peers)
        README.write_text(document, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
