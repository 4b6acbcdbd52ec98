"""Runs a plan on this machine: the one module that joins supervisor, processes and ROS.

The library entry behind `obk launch`. Takes a plan, gives how the run ended; prints nothing.
"""

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from types import FrameType

import psutil

from obk_cli.adapters.clock import local_time, monotonic_s, wall_s
from obk_cli.adapters.packages import PackageIndex
from obk_cli.adapters.processes import NodeCommand, WardenProcesses
from obk_cli.adapters.ros_environment import RosEnvironment
from obk_cli.adapters.ros_lifecycle import open_ros
from obk_cli.emit.params import emit_params, params_file_name
from obk_cli.emit.write import write_text
from obk_cli.errors import CommandFailedError
from obk_cli.launch.events import Ended, Heard, StopAsked, Told
from obk_cli.launch.journal import Journal
from obk_cli.launch.order import Until
from obk_cli.launch.runs import Run, make_run_folder, runs_folder, write_run
from obk_cli.launch.supervisor import Limits, Supervisor
from obk_cli.plan import Plan, Process
from obk_cli.surroundings import ExecutableMissing

__all__ = ["LaunchOptions", "run_plan"]

END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchOptions:
    """How a plan is run."""

    config: str
    """The config's path, for other terminals."""
    folder: Path
    """Where the nodes work."""
    until: Until = "active"
    duration_s: float | None = None
    """How long the stack stays up [s]; None: until it is asked to stop."""
    limits: Limits = field(default_factory=Limits)


def run_plan(
    plan: Plan,
    packages: PackageIndex,
    environment: RosEnvironment,
    options: LaunchOptions,
    *,
    on_start: Callable[[Path], None],
    on_event: Callable[[Told], None],
    on_line: Callable[[str, str], None],
) -> Ended:
    """Run a plan until it ends by itself, by a signal or by a failure.

    Args:
        plan: what to run.
        packages: where the executables are.
        environment: of the ROS processes.
        options: how far, how long.
        on_start: takes the run's folder.
        on_event: takes what happens, from the calling thread.
        on_line: takes a node's full name and a line of its output, from other threads.

    Raises:
        CommandFailedError: an executable is missing, or ROS does not start.
        OSError: the run's folder cannot be written.
    """
    inbox: SimpleQueue[Heard] = SimpleQueue()
    run_folder = make_run_folder(runs_folder(environment.variables), plan, local_time())
    on_start(run_folder)
    journal = Journal(run_folder)
    commands = {
        p.full_name: _node_command(p, packages, environment, run_folder) for p in plan.processes
    }

    def tell(event: Told) -> None:
        journal.event(event, wall_s())
        on_event(event)

    def line(node: str, text: str) -> None:
        journal.line(node, text)
        on_line(node, text)

    with ExitStack() as stack:
        stack.callback(journal.close)
        stack.enter_context(_signals_to(inbox))
        # Before ROS is there: its threads have no business in the warden's fork.
        processes = stack.enter_context(
            WardenProcesses(commands=commands, folder=options.folder, hear=inbox.put, on_line=line)
        )
        lifecycle = stack.enter_context(open_ros("obk_launch", environment))
        lifecycle.listen(inbox.put)
        write_run(run_folder, _run(plan, environment, options))
        supervisor = Supervisor(
            plan,
            processes=processes,
            lifecycle=lifecycle,
            inbox=inbox,
            clock=monotonic_s,
            tell=tell,
            limits=options.limits,
        )
        return supervisor.run(options.until, options.duration_s)


def _run(plan: Plan, environment: RosEnvironment, options: LaunchOptions) -> Run:
    this = psutil.Process()
    return Run(
        name=plan.name,
        pid=this.pid,
        started=this.create_time(),
        domain=environment.domain,
        config=options.config,
        nodes=tuple(p.full_name for tier in plan.tiers for p in tier),
    )


def _node_command(
    process: Process, packages: PackageIndex, environment: RosEnvironment, run_folder: Path
) -> NodeCommand:
    found = packages.find_executable(process.package, process.executable)
    if isinstance(found, ExecutableMissing):
        raise CommandFailedError(
            f"{process.origin}: there is no executable '{process.executable}' "
            f"in the package '{process.package}'",
            help=f"the package has: {', '.join(found.available) or 'none'}; "
            f"looked in {', '.join(found.searched)}",
        )
    params = run_folder / "params" / params_file_name(process)
    write_text(params, emit_params((process,)))
    return NodeCommand(
        arguments=(*found.arguments, *_ros_arguments(process, params)),
        environment=_node_environment(process, found.python_path, environment.variables),
    )


def _ros_arguments(process: Process, params: Path) -> Iterator[str]:
    yield from ("--ros-args", "-r", f"__node:={process.node}")
    if process.namespace not in ("", "/"):
        yield from ("-r", f"__ns:={process.namespace}")
    for source, target in process.remappings:
        yield from ("-r", f"{source}:={target}")
    yield from ("--params-file", str(params))
    if process.log_level:
        yield from ("--log-level", process.log_level)


def _node_environment(
    process: Process, python_path: tuple[Path, ...], variables: Mapping[str, str]
) -> dict[str, str]:
    merged = {**variables, **process.env}
    if python_path:
        inherited = merged.get("PYTHONPATH")
        parts = [*map(str, python_path), *([inherited] if inherited else [])]
        merged["PYTHONPATH"] = ":".join(parts)
    return merged


@contextmanager
def _signals_to(inbox: "SimpleQueue[Heard]") -> Iterator[None]:
    """While entered, SIGINT, SIGTERM and SIGHUP ask for the stack to stop."""

    def ask(number: int, _frame: FrameType | None) -> None:
        inbox.put(StopAsked(reason=signal.Signals(number).name))

    before = {number: signal.signal(number, ask) for number in END_SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
