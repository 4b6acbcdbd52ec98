"""Every goal of the specification that is a figure: where it is in the results, what it should be.

The groups are the sections of the specification's page on performance and the acceptance of
lock-step runs. A goal has a reason for the case that it is not met.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from benchmarks.loop.cases import LIBRARY

__all__ = ["GOALS", "Goal", "Results", "slowest_look"]

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
    why: str = ""
    """What stands in the way where it is not met."""

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


def modelled(figure: str) -> Callable[[Results], float]:
    """The least distance of lock-step runs with the measured bring-up from real ones [mrad]."""

    def find(results: Results) -> float:
        means: Mapping[str, Mapping[str, float]] = results["lockstep_truth"]["mean"]
        found = [mean[figure] for name, mean in means.items() if "measured bring-up" in name]
        if not found:
            raise KeyError(figure)
        return min(found)

    return find


def launch_faults(results: Results) -> float:
    """How many launches failed, and what launches and kills left."""
    launches: Mapping[str, Any] = results["launches"]
    return float(len(launches["failed"]) + len(launches["left_over"]))


def growth_of_a_trial(results: Results) -> float:
    """Memory that a trial of the arm adds [MB]."""
    memory: Mapping[str, float] = results["lockstep"]["memory"]
    return (memory["last_mb"] - memory["first_mb"]) / memory["trials"]


def digests(results: Results) -> float:
    """The most digests that an example had."""
    found: Mapping[str, list[str]] = results["lockstep"]["digests"]
    return float(max(map(len, found.values())))


WAKE: Final = (
    "on a virtual machine a thread that wakes up costs 20 µs and more before it has done anything, "
    "and finds cold caches; `C on rcl` in `loop.md` is what the middleware takes by itself"
)
COMPOSED: Final = (
    "the constructors of the user's messages, and the copies that keep their owners apart, take "
    "most of it"
)
LATE: Final = (
    "what a thread that only sleeps is late by, and what the host took meanwhile, stands at the "
    "head of `loop.md`; a processor that falls idle a thousand times a second is given back late"
)
WATCHED: Final = (
    "the dummy publishes 5,000 messages a second once a node subscribes to all of them, and each "
    "wakes a listener up; composed, that is the work of one interpreter"
)
STARTS: Final = (
    "the processor time of all processes is shared by two processors; half of it imports rclpy and "
    "numpy"
)
TOOL: Final = "the time is that of importing Python modules and of reading, on one processor"
SLOW: Final = "it is the work of one processor, and the goal is that of a quiet machine"
DELIVERY: Final = (
    "the dummy's step takes 2 to 4 µs, as much as two system calls. A loop with three groups that "
    "no node receives takes 3 times a bare step, samples and packing 1 more, and each of three "
    "deliveries wakes a thread: 2 to 4 µs, through DDS 6 to 20. That is within 1.25 where a step "
    "takes 50 µs and all nodes are in one process, or 75 µs in processes of their own"
)

PACED: Final = (
    "without a pace steps run in warm caches; a loop that only sleeps and calls `mj_step` takes "
    "many times its own steps, too: `bare_loop_over_its_steps_alone` in `simulator.json`, 21 on a "
    "busy machine"
)
BRING_UP: Final = (
    "the moment of the controller's first tick decides, and is known to 1 ms; two real runs differ "
    "by as much (`lockstep_truth.json`)"
)

LOOP: Final = (
    Goal(
        what="CPU of three nodes at 1 kHz, a process each, to rclpy's SingleThreadedExecutor",
        most=0.33,
        figure=ratio("separate", "cpu_percent"),
        why=WAKE,
    ),
    Goal(what="the same, next goal", most=0.2, figure=ratio("separate", "cpu_percent"), why=WAKE),
    Goal(
        what="the same, composed in one process",
        most=0.12,
        figure=ratio("composed", "cpu_percent"),
        why=COMPOSED,
    ),
    Goal(
        what="the same, composed, next goal",
        most=0.15,
        figure=ratio("composed", "cpu_percent"),
        why=COMPOSED,
    ),
    Goal(
        what="lateness of ticks p99, a process each, to the same",
        most=0.15,
        figure=ratio("separate", "late_p99_us"),
        why=LATE,
    ),
    Goal(
        what="the same, next goal",
        most=0.12,
        figure=ratio("separate", "late_p99_us"),
        why=LATE,
    ),
    Goal(
        what="latency from sensor to command p50, a process each",
        most=0.3,
        unit=" ms",
        figure=lambda results: float(
            loop(results, "separate")["figures"]["latency_p50_ms"]["median"]
        ),
        why="each node publishes from its own timer, so a value waits for the next tick of the "
        "estimator, and of the controller",
    ),
    Goal(
        what="1 kHz kept by the slowest node, a process each",
        least=99.8,
        unit=" %",
        figure=kept("separate", 1000),
        why=LATE,
    ),
    Goal(
        what="the same, composed",
        least=99.8,
        unit=" %",
        figure=kept("composed", 1000),
        why=LATE,
    ),
    Goal(
        what="2 kHz kept, composed",
        least=99.8,
        unit=" %",
        figure=kept("composed", 2000),
        why=LATE,
    ),
    Goal(
        what="CPU of a node's tick, 30 nodes to 3, a process each",
        most=1.2,
        figure=per_node("separate"),
        why="30 processes share two processors and their caches",
    ),
    Goal(what="the same, composed", most=1.2, figure=per_node("composed")),
    Goal(
        what="rates kept by the dummy stack while `obk monitor` watches and services are called",
        least=99.8,
        unit=" %",
        figure=watched("separate"),
        why=WATCHED,
    ),
    Goal(what="the same, composed", least=99.8, unit=" %", figure=watched("composed"), why=WATCHED),
    Goal(
        what="the slowest rate watched to the slowest of the stack alone, a process each",
        least=0.998,
        figure=at("watched", "watched_to_alone", "separate"),
        why=WATCHED,
    ),
    Goal(
        what="the same, composed",
        least=0.998,
        figure=at("watched", "watched_to_alone", "composed"),
        why=WATCHED,
    ),
)

SIMULATOR: Final = (
    Goal(
        what="the simulator's loop to bare `mj_step`, no sensors",
        most=1.1,
        figure=at("simulator", "cost", "no_sensors_over_mj_step"),
    ),
    Goal(
        what="the same, three groups at every step, heard in the same process",
        most=1.25,
        figure=at("simulator", "cost", "three_groups_heard_in_process_over_mj_step"),
        why=DELIVERY,
    ),
    Goal(
        what="the same, next goal",
        most=5.0,
        figure=at("simulator", "cost", "three_groups_heard_in_process_over_mj_step"),
        why=DELIVERY,
    ),
    Goal(
        what="the same, heard by another process of the run",
        most=5.0,
        figure=at("simulator", "cost", "three_groups_heard_in_run_over_mj_step"),
        why=DELIVERY,
    ),
    Goal(
        what="the same, heard by a foreign node through DDS",
        most=5.0,
        figure=at("simulator", "cost", "three_groups_heard_by_foreign_node_over_mj_step"),
        why=DELIVERY,
    ),
    Goal(
        what="real-time factor over 60 s",
        least=0.998,
        most=1.002,
        figure=at("simulator", "realtime", "realtime_factor"),
        why="the machine was too busy to take all steps",
    ),
    Goal(
        what="lateness of steps p99",
        most=300,
        unit=" µs",
        figure=at("simulator", "realtime", "late_us", "p99"),
        why=LATE,
    ),
    Goal(
        what="CPU at real time to that of the same work without a pace",
        most=1.3,
        figure=at("simulator", "realtime", "cpu_over_the_work_alone"),
        why=PACED,
    ),
    Goal(
        what="the same, next goal",
        most=3.0,
        figure=at("simulator", "realtime", "cpu_over_the_work_alone"),
        why=PACED,
    ),
    Goal(
        what="CPU at real time to that of a loop of `sleep` and `mj_step` at real time",
        most=3.0,
        figure=at("simulator", "realtime", "cpu_over_a_bare_loop"),
        why="four sensor groups and a loop in Python that is not in the caches when it wakes up",
    ),
    Goal(
        what="publishing `ObkJointEncoders` of 30 joints",
        most=40,
        unit=" µs",
        figure=at("simulator", "cost", "encoders_of_30_joints_heard_us", "median"),
    ),
)

TOOLS: Final = (
    Goal(
        what="`obk --help`",
        most=0.10,
        unit=" s",
        figure=at("tool", "runs", "obk --help", "median_s"),
        why=TOOL,
    ),
    Goal(
        what="`obk validate` of the dummy with its model",
        most=0.30,
        unit=" s",
        figure=at("tool", "runs", "obk validate dummy", "median_s"),
        why=TOOL,
    ),
    Goal(
        what="the same to `check-jsonschema`",
        most=1.0,
        figure=at("tool", "obk over check-jsonschema", "dummy"),
        why=TOOL,
    ),
    Goal(
        what="`obk validate` of 1,000 nodes",
        most=2.0,
        unit=" s",
        figure=at("tool", "runs", "obk validate big", "median_s"),
        why=TOOL,
    ),
    Goal(
        what="`obk lifecycle get` on a running stack",
        most=0.3,
        unit=" s",
        figure=at("looking", "commands", "lifecycle get", "median_s"),
        why=TOOL,
    ),
    Goal(
        what="the slowest of `obk topic list` and `info`, `node`, `param`, `service list`",
        most=0.5,
        unit=" s",
        figure=lambda results: slowest_look(results["looking"]["commands"], has_messages=False),
        why=TOOL,
    ),
    Goal(
        what="the slowest of `obk topic echo`, `hz`, `delay`, `pub` and `service call`",
        most=1.0,
        unit=" s",
        figure=lambda results: slowest_look(results["looking"]["commands"], has_messages=True),
        why="a participant of its own has to find the robot before it may speak; who moves a robot "
        "is to be recognizable in the graph, so the launcher's node does not publish in its place",
    ),
    Goal(
        what="`obk launch` of the dummy to all active",
        most=1.0,
        unit=" s",
        figure=at("launches", "up_s", "median"),
        why=STARTS,
    ),
    Goal(
        what="the same, of thirty nodes",
        most=3.0,
        unit=" s",
        figure=at("launches", "thirty_up_s", "median"),
        why=STARTS,
    ),
    Goal(what="its end", most=1.0, unit=" s", figure=at("launches", "down_s", "median")),
    Goal(
        what="launches that failed, processes and files that launches and kills left",
        most=0,
        figure=launch_faults,
        why="`launches.json` names them",
    ),
)

LOCKSTEP_ROWS: Final = (
    ("lock-step run of the dummy, everything recorded", 14, " x real time", "factors.dummy.best"),
    ("the same, of the arm", 9, " x real time", "factors.arm.best"),
    ("the same, of the quadruped", 4.5, " x real time", "factors.quadruped.best"),
    ("the same, of 31 nodes at 1 kHz", 1.9, " x real time", "factors.many.best"),
    ("5 s trials of the dummy per minute", 130, "", "trials.dummy.per_minute"),
    ("the same, of the arm", 90, "", "trials.arm.per_minute"),
    ("the same, of the quadruped", 48, "", "trials.quadruped.per_minute"),
)
"""What is measured, at least how much, its unit, and its place in the results."""
LOCKSTEP: Final = (
    *(
        Goal(what=what, least=least, unit=unit, figure=at("lockstep", *path.split(".")), why=SLOW)
        for what, least, unit, path in LOCKSTEP_ROWS
    ),
    Goal(
        what="start of a further trial",
        most=60,
        unit=" ms",
        figure=at("lockstep", "start", "further_ms"),
    ),
    Goal(
        what="cold `obk test` of one run of 5 s",
        most=2.5,
        unit=" s",
        figure=at("lockstep", "cold", "one_run_s"),
        why=STARTS,
    ),
    Goal(
        what="the tests of `examples/arm`",
        most=10,
        unit=" s",
        figure=at("lockstep", "cold", "tests_of_arm_s"),
        why=STARTS,
    ),
    Goal(
        what="memory of 200 trials of the arm",
        most=220,
        unit=" MB",
        figure=at("lockstep", "memory", "most_mb"),
    ),
    Goal(what="what a trial adds to it", most=0.4, unit=" MB", figure=growth_of_a_trial),
    Goal(
        what="digests of an example over five runs and four processes",
        most=1,
        figure=digests,
    ),
    Goal(
        what="quadruped with measured bring-up to a real run, rms",
        most=1.0,
        unit=" mrad",
        figure=modelled("rms_mrad"),
        why=BRING_UP,
    ),
    Goal(
        what="the same, greatest",
        most=4.0,
        unit=" mrad",
        figure=modelled("max_mrad"),
        why=BRING_UP,
    ),
)

GOALS: Final[Mapping[str, tuple[Goal, ...]]] = {
    "The loop": LOOP,
    "The simulator": SIMULATOR,
    "The tool": TOOLS,
    "Lock-step runs": LOCKSTEP,
}
"""Section -> its goals."""
