"""The diagrams of the design page and the concept pages, as boxes and arrows. Data only."""

from itertools import pairwise

from diagrams import Arrow, Box, Frame

__all__ = [
    "CLOCKS",
    "CLOCK_ARROWS",
    "LIFECYCLE",
    "LIFECYCLE_ARROWS",
    "LOCKSTEP",
    "LOCKSTEP_ARROWS",
    "PACKAGES",
    "PACKAGE_ARROWS",
    "RUNNING",
    "RUNNING_ARROWS",
    "RUNNING_FRAMES",
    "SIMULATOR",
    "SIMULATOR_ARROWS",
    "STAGES",
    "STAGE_ARROWS",
    "TICK",
    "TICK_ARROWS",
]


def _box(column: float, row: float, name: str, *lines: str, kind: str = "stage") -> Box:
    return Box(name=name, lines=lines, column=column, row=row, kind=kind)


STAGES = (
    _box(0, 1, "stack.yaml", "text, with its includes", kind="data"),
    _box(1, 1, "loader", "text to one tree: includes,", "${VARIABLES}, --set"),
    _box(2, 1, "reader", "tree to a typed config"),
    _box(3, 1, "locate", "files, types of the code,", "ray casters"),
    _box(4, 1, "check", "topology, types, models,", "packages, code"),
    _box(5, 1, "lower", "config to a plan;", "cannot fail"),
    _box(6, 1, "plan", "processes, parameters,", "rates, order", kind="data"),
    _box(
        3.5, 0, "environment", "MuJoCo's model, packages,", "files on this machine", kind="outside"
    ),
    _box(4.5, 0, "source_analysis", "nodes' Python source,", "read, never run"),
    _box(3, 2, "diagnostics", "code, message, location,", "help, fix", kind="data"),
    _box(4, 2, "report", "text, JSON, SARIF,", "GitHub", kind="result"),
    _box(6, 0, "emit", "parameters, launch file,", "diagrams, JSON", kind="result"),
    _box(6, 2, "launch", "a running stack", kind="result"),
)
_WAY = ("stack.yaml", "loader", "reader", "locate", "check", "lower", "plan")
STAGE_ARROWS = (
    *(Arrow(start=a, end=b) for a, b in pairwise(_WAY)),
    *(Arrow(start=name, end="diagnostics") for name in ("loader", "reader", "locate", "check")),
    Arrow(start="environment", end="locate"),
    Arrow(start="source_analysis", end="check"),
    Arrow(start="diagnostics", end="report"),
    Arrow(start="plan", end="emit"),
    Arrow(start="plan", end="launch"),
)

RUNNING = (
    _box(0, 1.3, "other terminals", "obk ps, lifecycle, stop,", "monitor, web", kind="outside"),
    _box(1.2, 0.3, "screen", "log and status; its queue", "drops and counts lines"),
    _box(2.2, 1.3, "supervisor", "the only thread", "that decides"),
    _box(1.2, 1.3, "control.sock", "one line of JSON each", "per request and reply"),
    _box(1.2, 2.3, "journal", "run.json, events.jsonl,", "one log per node"),
    _box(2.2, 0.3, "ROS thread", "transitions, states,", "heartbeat, /diagnostics"),
    _box(2.2, 2.3, "output readers", "one thread per node,", "which always reads"),
    _box(3.5, 1.3, "warden", "parent of all processes;", "stops all with the launcher"),
    _box(4.8, 0.3, "robot", "hardware or MuJoCo", kind="result"),
    _box(4.8, 1.3, "estimation", "sensors to a state", kind="result"),
    _box(4.8, 2.3, "control", "state to commands", kind="result"),
)
RUNNING_ARROWS = (
    Arrow(start="other terminals", end="control.sock", is_both_ways=True),
    Arrow(start="control.sock", end="supervisor", is_both_ways=True),
    Arrow(start="supervisor", end="screen"),
    Arrow(start="supervisor", end="journal"),
    Arrow(start="ROS thread", end="supervisor", is_both_ways=True),
    Arrow(start="output readers", end="supervisor"),
    Arrow(start="supervisor", end="warden", label="start, stop"),
    Arrow(start="warden", end="robot"),
    Arrow(start="warden", end="estimation"),
    Arrow(start="warden", end="control"),
    Arrow(
        start="ROS thread", end="robot", label="ROS 2: get_state, change_state", is_both_ways=True
    ),
    Arrow(start="control", end="output readers", label="output of nodes"),
)
RUNNING_FRAMES = (
    Frame(
        title="obk launch",
        names=("screen", "control.sock", "journal", "supervisor", "ROS thread", "output readers"),
    ),
    Frame(title="one process per node", names=("robot", "estimation", "control")),
)

LIFECYCLE = (
    _box(0, 1, "unconfigured", "the process runs;", "nothing is created"),
    _box(1.5, 1, "inactive", "publishers, subscriptions,", "timers exist"),
    _box(3, 1, "active", "publishers publish,", "timers run", kind="result"),
    _box(
        1.5, 0, "error processing", "on_error: everything", "is stopped and closed", kind="outside"
    ),
    _box(1.5, 2, "finalized", "the process exits", kind="data"),
)
LIFECYCLE_ARROWS = (
    Arrow(start="unconfigured", end="inactive", label="configure, cleanup", is_both_ways=True),
    Arrow(start="inactive", end="active", label="activate, deactivate", is_both_ways=True),
    Arrow(start="inactive", end="error processing"),
    Arrow(start="active", end="error processing", label="exception"),
    Arrow(start="error processing", end="unconfigured"),
    Arrow(start="unconfigured", end="finalized"),
    Arrow(start="inactive", end="finalized"),
    Arrow(start="active", end="finalized", label="shutdown"),
)

CLOCKS = (
    _box(0, 0, "simulated robot", "counts its steps", kind="result"),
    _box(1.3, 0, "clock page", "memory shared by the", "processes of the launch", kind="data"),
    _box(1.3, 1, "/clock", "messages, only while", "a node subscribes", kind="data"),
    _box(2.6, 0, "Python nodes", "of the robot's host:", "clocks, timers, stamps"),
    _box(2.6, 1, "other ROS nodes", "C++, other hosts,", "RViz, ros2 tools", kind="outside"),
    _box(0, 2, "wall clock", "of the host", kind="data"),
    _box(2.6, 2, "safety", "age of commands,", "heartbeats, time limits", kind="result"),
)
CLOCK_ARROWS = (
    Arrow(start="simulated robot", end="clock page"),
    Arrow(start="simulated robot", end="/clock"),
    Arrow(start="clock page", end="Python nodes"),
    Arrow(start="/clock", end="other ROS nodes"),
    Arrow(start="wall clock", end="safety"),
)

PACKAGES = (
    _box(1.8, 0, "obk_testing", "closed-loop tests", "in lockstep"),
    _box(0, 1, "obk_interfaces", "builds message packages"),
    _box(1.2, 1, "obk_cli", "the obk command:", "check, launch, inspect"),
    _box(2.4, 1, "obelisk_py", "runtime library,", "simulated robot"),
    _box(3.6, 1, "your nodes", "inherit from the library", kind="outside"),
    _box(1.2, 2, "obelisk_spec", "facts about the config", "language", kind="data"),
    _box(2.4, 2, "obelisk_recordings", "reads recordings", "as arrays"),
)
PACKAGE_ARROWS = (
    Arrow(start="obk_testing", end="obk_cli", label="imports"),
    Arrow(start="obk_testing", end="obelisk_py"),
    Arrow(start="your nodes", end="obelisk_py"),
    Arrow(start="obk_cli", end="obk_interfaces"),
    Arrow(start="obk_cli", end="obelisk_spec"),
    Arrow(start="obk_cli", end="obelisk_recordings"),
    Arrow(start="obelisk_py", end="obelisk_spec"),
    Arrow(start="obelisk_py", end="obelisk_recordings"),
    Arrow(start="obelisk_recordings", end="obelisk_spec"),
)

TICK = (
    _box(0, 1, "timerfd", "the kernel's timer", kind="outside"),
    _box(1, 1, "Worker", "epoll; one thread", "calls everything"),
    _box(2, 1, "your callback", "guarded, ticks counted", kind="result"),
    _box(3, 1, "publish", "picks one transport"),
    _box(4.1, 0, "MessageBuffer", "same process: a copy", kind="data"),
    _box(4.1, 1, "Unix socket", "same run: packed;", "wakes only the receiver", kind="data"),
    _box(4.1, 2, "DDS", "otherwise: packed;", "wakes an eventfd from C", kind="data"),
    _box(5.2, 1, "receiving Worker", "takes the message,", "calls the callback"),
)
TICK_ARROWS = (
    Arrow(start="timerfd", end="Worker"),
    Arrow(start="Worker", end="your callback"),
    Arrow(start="your callback", end="publish"),
    Arrow(start="publish", end="MessageBuffer"),
    Arrow(start="publish", end="Unix socket"),
    Arrow(start="publish", end="DDS"),
    Arrow(start="MessageBuffer", end="receiving Worker"),
    Arrow(start="Unix socket", end="receiving Worker"),
    Arrow(start="DDS", end="receiving Worker"),
)

SIMULATOR = (
    _box(0, 0, "step_queue", "reset, pause, step", kind="data"),
    _box(0, 1, "commands", "the latest one,", "and its age", kind="data"),
    _box(1.2, 1, "stepping thread", "the only one that", "uses the simulation", kind="result"),
    _box(2.4, 0, "outputs", "sensor groups, noise,", "time"),
    _box(2.4, 1, "cameras", "one thread each,", "with OpenGL"),
    _box(2.4, 2, "viewers, video", "low-priority processes;", "may miss states"),
    _box(3.6, 0, "topics, time", "as messages and", "on the clock page", kind="outside"),
)
SIMULATOR_ARROWS = (
    Arrow(start="step_queue", end="stepping thread"),
    Arrow(start="commands", end="stepping thread"),
    Arrow(start="stepping thread", end="outputs"),
    Arrow(start="stepping thread", end="cameras"),
    Arrow(start="stepping thread", end="viewers, video"),
    Arrow(start="outputs", end="topics, time"),
)

LOCKSTEP = (
    _box(0, 1, "heap of events", "time, kind, order,", "node, call", kind="data"),
    _box(1.2, 1, "scheduler", "advances time to the next", "event and calls it"),
    _box(2.4, 0, "simulator", "a step", kind="result"),
    _box(2.4, 1, "nodes", "messages, timers", kind="outside"),
    _box(2.4, 2, "the test", "push, delay, kill"),
)
LOCKSTEP_ARROWS = (
    Arrow(start="heap of events", end="scheduler", is_both_ways=True),
    Arrow(start="scheduler", end="simulator", is_both_ways=True),
    Arrow(start="scheduler", end="nodes", is_both_ways=True),
    Arrow(start="scheduler", end="the test", is_both_ways=True),
)
