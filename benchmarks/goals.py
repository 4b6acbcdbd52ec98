"""Every goal: where to find its measured value, and the expected range.

A goal also has the reason to print if it is not met.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from benchmarks.loop.cases import LIBRARY

__all__ = ["GOALS", "Goal", "Results", "slowest_look"]

OF_MESSAGES: Final = ("topic echo", "topic hz", "topic delay", "topic pub", "service call")
"""Commands that start their own ROS participant."""
WORK: Final = {"rate_hz": 1000, "joints": 30, "nodes": 3}

Results = Mapping[str, Any]
"""The contents of the JSON files, by file name without the extension."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """One measured value and its expected range."""

    what: str
    least: float | None = None
    most: float | None = None
    unit: str = ""
    figure: Callable[[Results], float]
    why: str = ""
    """The reason to print if the goal is not met."""

    @property
    def limits(self) -> str:
        """The expected range as text: `≤ 0.33`, `0.8 to 1.2`."""
        if self.least is not None and self.most is not None:
            return f"{self.least:g} to {self.most:g}{self.unit}"
        sign, limit = ("≤", self.most) if self.least is None else ("≥", self.least)
        return f"{sign} {limit:g}{self.unit}"

    def is_met_by(self, value: float) -> bool:
        """Whether a value is in the expected range."""
        return (self.least is None or value >= self.least) and (
            self.most is None or value <= self.most
        )


def loop(results: Results, layout: str, **point: int) -> Mapping[str, Any]:
    """The library's row in the results of the loop at one point."""
    wanted = {"contestant": LIBRARY, "layout": layout, **WORK, **point}
    rows: list[Mapping[str, Any]] = results["loop"]["cases"]
    found = next((row for row in rows if row["case"] == wanted and row["runs"]), None)
    if found is None:
        raise KeyError(f"{wanted} was not measured")
    return found


def ratio(layout: str, name: str) -> Callable[[Results], float]:
    """A median ratio to rclpy's executor in the `work` part."""
    return lambda results: float(loop(results, layout)["ratios"][name]["median"])


def kept(layout: str, rate_hz: int) -> Callable[[Results], float]:
    """The part of its rate that the slowest node achieved in the worst round [%]."""
    return lambda results: (
        100 * float(loop(results, layout, rate_hz=rate_hz)["figures"]["rate_hz"]["min"]) / rate_hz
    )


def per_node(layout: str) -> Callable[[Results], float]:
    """CPU time per tick with 30 nodes, relative to 3 nodes, at 100 Hz."""

    def each(results: Results, nodes: int) -> float:
        row = loop(results, layout, rate_hz=100, nodes=nodes)
        return float(row["figures"]["cpu_per_tick_us"]["median"])

    return lambda results: each(results, 30) / each(results, 3)


def watched(layout: str) -> Callable[[Results], float]:
    """The lowest percentage of an expected rate while the stack is monitored."""
    return lambda results: 100 * float(results["watched"]["least_kept"][f"{layout}, watched"])


def slowest_look(
    commands: Mapping[str, Mapping[str, float]], *, has_messages: bool = False
) -> float:
    """The longest median of a command, minus the `--duration` that it measures for [s].

    Args:
        commands: the times of each command, by its arguments.
        has_messages: consider commands that send or receive messages; otherwise all others.

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
    """Read a number from the results."""

    def find(results: Results) -> float:
        found: Any = results
        for name in path:
            found = found[name]
        return float(found)

    return find


def modelled(figure: str) -> Callable[[Results], float]:
    """The smallest distance between real runs and lockstep runs with measured bring-up [mrad]."""

    def find(results: Results) -> float:
        means: Mapping[str, Mapping[str, float]] = results["lockstep_truth"]["mean"]
        found = [mean[figure] for name, mean in means.items() if "measured bring-up" in name]
        if not found:
            raise KeyError(figure)
        return min(found)

    return find


def launch_faults(results: Results) -> float:
    """The number of failed launches, and of leftovers after launches and kills."""
    launches: Mapping[str, Any] = results["launches"]
    return float(len(launches["failed"]) + len(launches["left_over"]))


def growth_of_a_trial(results: Results) -> float:
    """Memory that each trial of the arm adds [MB]."""
    memory: Mapping[str, float] = results["lockstep"]["memory"]
    return (memory["last_mb"] - memory["first_mb"]) / memory["trials"]


def digests(results: Results) -> float:
    """The highest number of different digests of an example."""
    found: Mapping[str, list[str]] = results["lockstep"]["digests"]
    return float(max(map(len, found.values())))


WAKE: Final = (
    "on a virtual machine, waking a thread costs at least 20 µs, and the caches are cold; "
    "`C on rcl` in `loop.md` shows the cost of the middleware alone"
)
COMPOSED: Final = (
    "most of the time is spent constructing the user's messages and copying them so that nodes do "
    "not share data"
)
LATE: Final = (
    "the header of `loop.md` shows how late a thread is that only sleeps, and how much time the "
    "host stole; the host is slow to give back a core that becomes idle a thousand times a second. "
    "`C on rcl` in `loop.md` shows what is possible on this machine"
)
WATCHED: Final = (
    "the dummy publishes 5,000 messages per second if a node subscribes to all of them, and each "
    "message wakes a receiver; if composed, a single interpreter does all of that"
)
STARTS: Final = "most of the time is spent importing Python modules, on one core"
LAUNCHES: Final = (
    "a third of the time is spent importing Python modules; another third is the discovery of the "
    "nodes by the launcher, for which DDS takes 0.1 to 0.2 s per participant"
)
DISCOVERS: Final = (
    "all processes share two cores, and more than half of their CPU time is discovery: each of 31 "
    "DDS participants learns of about 30 endpoints of each of the others"
)
TOOL: Final = "the time is spent importing Python modules and reading files, on one core"
SLOW: Final = "the work runs on one core, and the goal assumes an idle machine"
DELIVERY: Final = (
    "a step of the dummy takes 2 µs, as long as one or two system calls. The loop takes twice as "
    "long as a bare step if no node receives its three groups. Each delivery wakes another thread "
    "and adds 3 to 4 µs, 5 µs in the same process, where that thread competes for the "
    "interpreter, or 7 µs through DDS. The ratio is below 1.25 if a step takes at least 70 µs with "
    "all nodes in one process, or 50 µs with one process per node"
)

PACED: Final = (
    "a thread that only sleeps until each step is due takes about twice as long as the work "
    "(`sleeping_over_the_work_alone` in `simulator.json`), and a program in C that does the same "
    "takes about as long: after each sleep, the caches are cold"
)
BRING_UP: Final = (
    "the result depends on the time of the controller's first tick, which is known to 1 ms only; "
    "two real runs differ by as much (`lockstep_truth.json`)"
)

LOOP: Final = (
    Goal(
        what="CPU of three 1 kHz nodes, one process each, relative to SingleThreadedExecutor",
        most=0.33,
        figure=ratio("separate", "cpu_percent"),
        why=WAKE,
    ),
    Goal(
        what="the same, revised goal",
        most=0.2,
        figure=ratio("separate", "cpu_percent"),
        why=WAKE,
    ),
    Goal(
        what="the same, composed in one process",
        most=0.12,
        figure=ratio("composed", "cpu_percent"),
        why=COMPOSED,
    ),
    Goal(
        what="the same, composed, revised goal",
        most=0.15,
        figure=ratio("composed", "cpu_percent"),
        why=COMPOSED,
    ),
    Goal(
        what="p99 lateness of ticks, one process per node, relative to SingleThreadedExecutor",
        most=0.15,
        figure=ratio("separate", "late_p99_us"),
        why=LATE,
    ),
    Goal(
        what="the same, revised goal",
        most=0.12,
        figure=ratio("separate", "late_p99_us"),
        why=LATE,
    ),
    Goal(
        what="p50 latency from sensor to command, one process per node",
        most=0.3,
        unit=" ms",
        figure=lambda results: float(
            loop(results, "separate")["figures"]["latency_p50_ms"]["median"]
        ),
        why="the controller ticks a quarter of a period after the sensor, so that the estimate is "
        "there in time; the rest is the time that its command takes to wake the simulator",
    ),
    Goal(
        what="share of 1 kHz that the slowest node achieves, one process per node",
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
        what="share of 2 kHz that the slowest node achieves, composed",
        least=99.8,
        unit=" %",
        figure=kept("composed", 2000),
        why=LATE,
    ),
    Goal(
        what="CPU per tick of 30 nodes relative to 3 nodes, one process per node",
        most=1.2,
        figure=per_node("separate"),
        why="30 processes share two cores and their caches",
    ),
    Goal(what="the same, composed", most=1.2, figure=per_node("composed")),
    Goal(
        what="share of its rates that the dummy achieves while `obk monitor` and services run",
        least=99.8,
        unit=" %",
        figure=watched("separate"),
        why=WATCHED,
    ),
    Goal(what="the same, composed", least=99.8, unit=" %", figure=watched("composed"), why=WATCHED),
    Goal(
        what="slowest rate while monitored, relative to unmonitored, one process per node",
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
        what="the simulator's loop relative to bare `mj_step`, no sensors",
        most=1.1,
        figure=at("simulator", "cost", "no_sensors_over_mj_step"),
    ),
    Goal(
        what="the same, three groups at every step, received in the same process",
        most=1.25,
        figure=at("simulator", "cost", "three_groups_heard_in_process_over_mj_step"),
        why=DELIVERY,
    ),
    Goal(
        what="the same, revised goal",
        most=5.0,
        figure=at("simulator", "cost", "three_groups_heard_in_process_over_mj_step"),
        why=DELIVERY,
    ),
    Goal(
        what="the same, received by another process of the run",
        most=5.0,
        figure=at("simulator", "cost", "three_groups_heard_in_run_over_mj_step"),
        why=DELIVERY,
    ),
    Goal(
        what="the same, received by a foreign node through DDS",
        most=5.0,
        figure=at("simulator", "cost", "three_groups_heard_by_foreign_node_over_mj_step"),
        why=DELIVERY,
    ),
    Goal(
        what="real-time factor over 60 s",
        least=0.998,
        most=1.002,
        figure=at("simulator", "realtime", "realtime_factor"),
        why="the machine was too busy to keep up with all steps",
    ),
    Goal(
        what="p99 lateness of steps",
        most=300,
        unit=" µs",
        figure=at("simulator", "realtime", "late_us", "p99"),
        why=LATE,
    ),
    Goal(
        what="CPU at real time, relative to the same work without pacing",
        most=1.3,
        figure=at("simulator", "realtime", "cpu_over_the_work_alone"),
        why=PACED,
    ),
    Goal(
        what="the same, revised goal",
        most=3.0,
        figure=at("simulator", "realtime", "cpu_over_the_work_alone"),
        why=PACED,
    ),
    Goal(
        what="the same, without the CPU time of a loop that only sleeps until each step is due",
        most=3.0,
        figure=at("simulator", "realtime", "cpu_beyond_sleeping_over_the_work_alone"),
        why="after each sleep, the caches are cold",
    ),
    Goal(
        what="CPU at real time, relative to a loop of `sleep` and `mj_step` at real time",
        most=3.0,
        figure=at("simulator", "realtime", "cpu_over_a_bare_loop"),
        why="four sensor groups, and a Python loop that is no longer cached when it wakes up",
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
        what="the same, relative to `check-jsonschema`",
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
        what="slowest of `obk topic list` and `info`, `node`, `param`, `service list`",
        most=0.5,
        unit=" s",
        figure=lambda results: slowest_look(results["looking"]["commands"], has_messages=False),
        why=TOOL,
    ),
    Goal(
        what="slowest of `obk topic echo`, `hz`, `delay`, `pub` and `service call`",
        most=1.0,
        unit=" s",
        figure=lambda results: slowest_look(results["looking"]["commands"], has_messages=True),
        why="the command starts its own participant, which must discover the robot before it "
        "publishes. The launcher's node does not publish for it, because the graph must show which "
        "process moves a robot",
    ),
    Goal(
        what="`obk launch` of the dummy until all nodes are active",
        most=1.0,
        unit=" s",
        figure=at("launches", "up_s", "median"),
        why=LAUNCHES,
    ),
    Goal(
        what="the same, of thirty nodes",
        most=3.0,
        unit=" s",
        figure=at("launches", "thirty_up_s", "median"),
        why=DISCOVERS,
    ),
    Goal(
        what="shutdown of the dummy", most=1.0, unit=" s", figure=at("launches", "down_s", "median")
    ),
    Goal(
        what="failed launches, and processes and files left by launches and kills",
        most=0,
        figure=launch_faults,
        why="see `launches.json`",
    ),
)

LOCKSTEP_ROWS: Final = (
    ("lockstep run of the dummy, everything recorded", 14, " x real time", "factors.dummy.best"),
    ("the same, of the arm", 9, " x real time", "factors.arm.best"),
    ("the same, of the quadruped", 4.5, " x real time", "factors.quadruped.best"),
    ("the same, of 31 nodes at 1 kHz", 1.9, " x real time", "factors.many.best"),
    ("trials of 5 s per minute, of the dummy", 130, "", "trials.dummy.per_minute"),
    ("the same, of the arm", 90, "", "trials.arm.per_minute"),
    ("the same, of the quadruped", 48, "", "trials.quadruped.per_minute"),
)
"""What is measured, the lower limit, the unit, and the path in the results."""
LOCKSTEP: Final = (
    *(
        Goal(what=what, least=least, unit=unit, figure=at("lockstep", *path.split(".")), why=SLOW)
        for what, least, unit, path in LOCKSTEP_ROWS
    ),
    Goal(
        what="startup of a further trial",
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
    Goal(what="memory that each trial adds", most=0.4, unit=" MB", figure=growth_of_a_trial),
    Goal(
        what="different digests of an example in five runs and four processes",
        most=1,
        figure=digests,
    ),
    Goal(
        what="rms distance of the quadruped with measured bring-up from a real run",
        most=1.0,
        unit=" mrad",
        figure=modelled("rms_mrad"),
        why=BRING_UP,
    ),
    Goal(
        what="the same, maximum",
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
    "Lockstep runs": LOCKSTEP,
}
"""Section -> its goals."""
