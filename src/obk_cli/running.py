"""Runs a plan on this machine: the one module that joins supervisor, processes and ROS.

The library entry behind `obk launch`. Takes a plan, gives how the run ended. Runs on without log
files where they cannot be written, and never waits for whoever reads the screen.
"""

import signal
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Final, Protocol

from obk_cli.adapters.clock import local_time, monotonic_s, wall_s
from obk_cli.adapters.live_runs import claim_run, this_process
from obk_cli.adapters.packages import PackageIndex
from obk_cli.adapters.processes import NodeCommand, WardenProcesses
from obk_cli.adapters.ros_environment import RosEnvironment
from obk_cli.adapters.ros_lifecycle import RosLifecycle, open_ros
from obk_cli.adapters.screen import Screen
from obk_cli.adapters.shared_memory import remove_dead_segments
from obk_cli.emit.params import emit_params, params_file_name
from obk_cli.emit.write import write_text
from obk_cli.errors import CommandFailedError
from obk_cli.launch.events import Ended, Heard, StopAsked, Told
from obk_cli.launch.journal import Journal
from obk_cli.launch.order import Until
from obk_cli.launch.runs import Run, runs_folder, write_run
from obk_cli.launch.supervisor import Limits, Supervisor
from obk_cli.plan import Plan, Process
from obk_cli.report.escapes import plain
from obk_cli.surroundings import Command, ExecutableMissing

__all__ = ["LaunchOptions", "Voice", "run_plan"]

END_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
DISCOVERY_S: Final = 0.4
"""How long nodes that run already have to be found [s]."""
NO_LOGS: Final = "no log files from here on"


class Voice(Protocol):
    """Turns what happens into lines for the user."""

    def event(self, event: Told) -> Iterable[str]:
        """The lines for an event."""

    def line(self, node: str, text: str) -> Iterable[str]:
        """The lines for one of a node's output; called from several threads."""


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
    screen: Screen,
    voice: Voice,
) -> Ended:
    """Run a plan until it ends by itself, by a signal or by a failure.

    Args:
        plan: what to run.
        packages: where the executables are.
        environment: of the ROS processes.
        options: how far, how long.
        screen: shows what happens; when nobody reads it any more the stack is brought down.
        voice: turns what happens into lines.

    Raises:
        CommandFailedError: an executable is missing, the stack or one of its nodes runs already,
            ROS does not start, or there is not even a temporary folder for the parameters.
    """
    inbox: SimpleQueue[Heard] = SimpleQueue()
    executables = {p.full_name: (p, _executable(p, packages)) for p in plan.processes}
    with ExitStack() as stack:
        stack.enter_context(_signals_to(inbox))
        stack.callback(remove_dead_segments)
        screen.when_closed(lambda: inbox.put(StopAsked(reason="the output was closed")))
        run_folder = _claim(plan, environment, options, screen, stack)
        output = _Output(run_folder, screen, voice)
        stack.callback(output.journal.close)
        params = _write_params(plan, run_folder, output, stack)
        commands = {
            name: NodeCommand(
                arguments=(*found.arguments, *_ros_arguments(process, params[name])),
                environment=_node_environment(process, found.python_path, environment.variables),
            )
            for name, (process, found) in executables.items()
        }
        # Before ROS is there: its threads have no business in the warden's fork.
        processes = stack.enter_context(
            WardenProcesses(
                commands=commands, folder=options.folder, hear=inbox.put, on_line=output.line
            )
        )
        lifecycle = stack.enter_context(open_ros("obk_launch", environment))
        _refuse_taken_names(plan, lifecycle, environment)
        lifecycle.listen(inbox.put)
        supervisor = Supervisor(
            plan,
            processes=processes,
            lifecycle=lifecycle,
            inbox=inbox,
            clock=monotonic_s,
            tell=output.event,
            limits=options.limits,
        )
        return supervisor.run(options.until, options.duration_s)


class _Output:
    """Where events and output go: the run's files and the screen."""

    def __init__(self, run_folder: Path | None, screen: Screen, voice: Voice) -> None:
        self._screen = screen
        self._voice = voice
        self.journal = Journal(run_folder, self.unwritable)

    def event(self, event: Told) -> None:
        self.journal.event(event, wall_s())
        for text in self._voice.event(event):
            self.journal.shown(plain(text))
            self._screen.put(text)

    def line(self, node: str, line: str) -> None:
        self.journal.line(node, line)
        for text in self._voice.line(node, line):
            self.journal.shown(plain(text))
            self._screen.put(text, may_drop=True)

    def unwritable(self, error: OSError) -> None:
        self._screen.put(f"warning: {NO_LOGS}: {error}")


def _claim(
    plan: Plan,
    environment: RosEnvironment,
    options: LaunchOptions,
    screen: Screen,
    stack: ExitStack,
) -> Path | None:
    """The run's folder, once it is sure that the stack does not run yet; None: not writable."""
    parent = runs_folder(environment.variables)
    pid, started = this_process()
    run = Run(
        name=plan.name,
        pid=pid,
        started=started,
        domain=environment.domain,
        config=options.config,
        nodes=tuple(p.full_name for tier in plan.tiers for p in tier if p.has_lifecycle),
        other_nodes=tuple(p.full_name for p in plan.processes if not p.has_lifecycle),
    )
    try:
        folder = claim_run(parent, run, local_time())
    except OSError as error:
        screen.put(f"warning: {NO_LOGS}: {error}")
        return None
    stack.callback(_note_end, folder, run)
    screen.put(f"{plan.name}: logs in {folder}")
    return folder


def _note_end(folder: Path, run: Run) -> None:
    # Where it cannot be noted, the launcher's end will tell.
    with suppress(OSError):
        write_run(folder, replace(run, ended=wall_s()))


def _refuse_taken_names(plan: Plan, lifecycle: RosLifecycle, environment: RosEnvironment) -> None:
    """Look for the stack's nodes among those that run: started on another host, or without obk."""
    taken = lifecycle.taken((p.full_name for p in plan.processes), DISCOVERY_S)
    if taken:
        raise CommandFailedError(
            f"in the ROS domain {environment.domain} there is already {', '.join(taken)}",
            help="stop what runs there or use another ROS_DOMAIN_ID; "
            "`obk lifecycle get` shows the nodes",
        )


def _executable(process: Process, packages: PackageIndex) -> Command:
    found = packages.find_executable(process.package, process.executable)
    if isinstance(found, ExecutableMissing):
        raise CommandFailedError(
            f"{process.origin}: there is no executable '{process.executable}' "
            f"in the package '{process.package}'",
            help=f"the package has: {', '.join(found.available) or 'none'}; "
            f"looked in {', '.join(found.searched)}",
        )
    return found


def _write_params(
    plan: Plan, run_folder: Path | None, output: _Output, stack: ExitStack
) -> Mapping[str, Path]:
    """Parameter files by node; where the run's folder takes none, in one that goes at the end."""
    if run_folder is not None:
        try:
            return _params_in(run_folder, plan)
        except OSError as error:
            output.unwritable(error)
    try:
        temporary = stack.enter_context(TemporaryDirectory(prefix="obk-"))
        return _params_in(Path(temporary), plan)
    except OSError as error:
        raise CommandFailedError(f"the parameters cannot be written: {error}") from error


def _params_in(folder: Path, plan: Plan) -> Mapping[str, Path]:
    files = {p.full_name: folder / "params" / params_file_name(p) for p in plan.processes}
    for process in plan.processes:
        write_text(files[process.full_name], emit_params((process,)))
    return files


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
        # A closing terminal sends SIGHUP more than once, and nobody's impatience.
        is_urgent = number != signal.SIGHUP
        inbox.put(StopAsked(reason=signal.Signals(number).name, is_urgent=is_urgent))

    before = {number: signal.signal(number, ask) for number in END_SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
