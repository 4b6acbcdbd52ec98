"""Run a plan on this machine until it ends by itself, by a signal or by a failure.

The entry point behind `obk launch`: connects the supervisor with processes, ROS and the console.
A run continues without log files if they cannot be written, and never waits for a slow reader of
the screen.
"""

import signal
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from queue import SimpleQueue
from shutil import rmtree
from tempfile import TemporaryDirectory
from typing import Final

from obk_cli.clock import monotonic_s
from obk_cli.errors import CommandFailedError
from obk_cli.launch.commands import (
    Executables,
    composable,
    control_variables,
    early_units,
    find_executables,
    gate_variables,
    held_at_gate,
    socket_folder,
    unit_commands,
    with_clock_page,
)
from obk_cli.launch.conflicts import (
    may_have_others,
    refuse_taken_names,
    refuse_unknown_publishers,
    watching_publishers,
    watching_types,
)
from obk_cli.launch.console import Console, Output
from obk_cli.launch.events import (
    Ended,
    EventBus,
    InputEvent,
    OutputEvent,
    OutputLine,
    StackStateChanged,
    StopRequested,
)
from obk_cli.launch.external_rates import ExternalRates
from obk_cli.launch.options import LaunchOptions
from obk_cli.launch.preloading import preload_for
from obk_cli.launch.process_groups import Unit, units_of
from obk_cli.launch.processes import NodeCommand, ProcessEvent, WardenProcesses
from obk_cli.launch.recorder import Recorder, VideoReports
from obk_cli.launch.ros_nodes import RosNodes, open_ros_nodes
from obk_cli.launch.run_lock import locked_run
from obk_cli.launch.simulated_duration import counting
from obk_cli.launch.state_node import StateNode, state_node_name
from obk_cli.launch.supervisor import Supervisor
from obk_cli.launch.warden_client import WardenClient, running_warden
from obk_cli.plan.plan import Plan
from obk_cli.process.identity import launch_marks
from obk_cli.process.shared_memory import remove_dead_segments
from obk_cli.process.signals import handle_end_signals
from obk_cli.ros.environment import RosEnvironment
from obk_cli.workspace.package_index import PackageIndex
from obk_cli.workspace.share_prefix import make_share_prefix, with_prefix

__all__ = ["run_plan"]

_QUICK_UNITS: Final = 8
"""Number of processes up to which all announce themselves often at first, so that they have usually
discovered each other before they become active. Larger stacks take longer to start anyway."""


def run_plan(
    plan: Plan,
    packages: PackageIndex,
    environment: RosEnvironment,
    options: LaunchOptions,
    console: Console,
    warden: WardenClient | None = None,
) -> Ended:
    """Run a plan until it ends by itself, by a signal or by a failure.

    Args:
        plan: what to run.
        packages: where the executables are found.
        environment: the environment of the ROS processes.
        options: which part of the plan runs, how far and how long.
        console: shows events; if its output is closed, the stack is brought down.
        warden: the parent of the processes; None: a new one.

    Raises:
        CommandFailedError: an executable is missing, the stack or one of its nodes is already
            running, another node moves the robot, ROS does not start, or no folder is writable.
    """
    inbox, share = SimpleQueue[InputEvent](), options.share
    executables, units = _units(plan, packages, options)
    with ExitStack() as stack:
        stack.enter_context(handle_end_signals(_requesting_stop(inbox)))
        stack.callback(remove_dead_segments)
        console.screen.when_closed(lambda: inbox.put(StopRequested(reason="the output was closed")))
        lock = stack.enter_context(locked_run(plan, environment, options))
        formatter = console.formatter(plan, units, leads=share.leads)
        output = stack.enter_context(Output(lock.folder, console.screen, formatter, units))
        lock.report(output)
        marks = launch_marks(lock.folder)
        launcher = environment.with_quick_discovery()
        of_nodes = launcher if len(units) <= _QUICK_UNITS else environment
        sockets = stack.enter_context(socket_folder(lock.folder, environment.variables))
        variables = {
            **of_nodes.variables,
            **marks,
            **gate_variables(lock.folder),
            **control_variables(lock.folder),
            **sockets,
        }
        commands, common = _commands(
            units, executables, lock.folder, variables, packages, output, stack
        )
        commands, clock = stack.enter_context(with_clock_page(plan, units, commands))
        stop_counted = _requesting_end(inbox, options.sim_duration_s)
        count = stack.enter_context(counting(clock, options.sim_duration_s, stop_counted))
        recorder = Recorder(options.recording, lock.folder, output)
        videos = VideoReports(plan, share, output.note)
        programs = [command.in_python for command in commands.values()]
        if warden is None:
            # Before ROS starts, so that its threads are not part of the warden's fork.
            warden = stack.enter_context(running_warden(marks))
        warden.use_preload(preload_for(programs, common))
        # Before the run's processes join the domain.
        has_others = may_have_others(environment)
        processes = stack.enter_context(
            WardenProcesses(
                commands={**commands, **recorder.commands({**variables, **launcher.variables})},
                folder=options.folder,
                warden=warden,
                on_event=_process_events(recorder, inbox).publish,
                on_line=_lines(output, recorder).publish,
            )
        )
        recorder.start(processes)
        gated = early_units(units, executables, options.gated_executables)
        with held_at_gate(lock.folder, gated, processes):
            ros = stack.enter_context(open_ros_nodes("obk_launch", launcher))
            # The following steps run while discovery continues.
            ros.report_to(inbox.put)
            _prepare_for(units, ros)
            _serve_others(lock.folder, ros, inbox, output, stack)
            if has_others:
                _refuse_conflicts(plan, units, ros, environment, options)
            if not options.allows_foreign:
                stack.enter_context(watching_publishers(plan, ros, inbox.put, output.note))
        stack.enter_context(watching_types(plan, ros.graph, output.note))
        state_node = StateNode(ros, plan.name, inbox.put, output.note) if share.leads else None
        local = [node for unit in units for node in unit.nodes]
        external = stack.enter_context(ExternalRates(ros.participant(), local, inbox.put))
        supervisor = Supervisor(
            plan,
            units=units,
            processes=processes,
            lifecycle=ros,
            inbox=inbox,
            clock=monotonic_s,
            publish=_events(recorder, videos, external, count, state_node, output).publish,
            limits=options.limits,
            on_crash=options.on_crash,
            strict_rates=options.strict_rates,
            lead=None if share.leads else _state_node(plan),
        )
        recorder.wait_until_started()
        lock.ended = supervisor.run(options.until, options.duration_s)
        return lock.ended


def _process_events(recorder: Recorder, inbox: "SimpleQueue[InputEvent]") -> EventBus[ProcessEvent]:
    """The bus for starts and ends of processes; the supervisor ignores those of the recorder."""
    bus = EventBus[ProcessEvent]()
    bus.subscribe(recorder.on_process_event)
    bus.subscribe(inbox.put)
    return bus


def _lines(output: Output, recorder: Recorder) -> EventBus[OutputLine]:
    """The bus for output lines of processes."""
    bus = EventBus[OutputLine]()
    bus.subscribe(output.line)
    bus.subscribe(recorder.on_line)
    return bus


def _events(
    recorder: Recorder,
    videos: VideoReports,
    external: ExternalRates,
    count: Callable[[OutputEvent], None],
    state_node: StateNode | None,
    output: Output,
) -> EventBus[OutputEvent]:
    """The bus for events of the supervisor.

    At shutdown, the recording is closed and the videos are reported before the end of the run is
    shown.
    """
    bus = EventBus[OutputEvent]()
    bus.subscribe(recorder.on_event)
    bus.subscribe(videos.on_event)
    bus.subscribe(external.on_event)
    bus.subscribe(count)
    if state_node is not None:
        bus.subscribe(_shown_by(state_node))
    bus.subscribe(output.event)
    return bus


def _shown_by(node: StateNode) -> Callable[[OutputEvent], None]:
    def show(event: OutputEvent) -> None:
        if isinstance(event, StackStateChanged):
            node.show(event.state)

    return show


def _units(
    plan: Plan, packages: PackageIndex, options: LaunchOptions
) -> tuple[Executables, tuple[Unit, ...]]:
    """The programs of the nodes that run here, and the processes that run them."""
    here = [node for node in plan.nodes if node.device in options.share.devices]
    executables = find_executables(here, packages)
    together = composable(here, executables) if options.is_composed else frozenset[str]()
    return executables, units_of(plan, devices=options.share.devices, together=together)


def _refuse_conflicts(
    plan: Plan,
    units: tuple[Unit, ...],
    ros: RosNodes,
    environment: RosEnvironment,
    options: LaunchOptions,
) -> None:
    """Check that no other node uses the stack's names or moves its robot."""
    own = [_state_node(plan)] if options.share.leads else []
    names = (*own, *(name for unit in units for name in unit.node_names))
    refuse_taken_names(names, ros, environment.domain)
    if not options.allows_foreign:
        refuse_unknown_publishers(plan, ros, environment.domain)


def _state_node(plan: Plan) -> str:
    return f"/{state_node_name(plan.name)}"


def _prepare_for(units: tuple[Unit, ...], ros: RosNodes) -> None:
    """Create the clients and subscriptions for the nodes before they start."""
    nodes = [node for unit in units for node in unit.nodes]
    ros.report_diagnostics(node.full_name for node in nodes)
    ros.prepare(node.full_name for node in nodes if node.has_lifecycle)


def _serve_others(
    folder: Path | None,
    ros: RosNodes,
    inbox: "SimpleQueue[InputEvent]",
    output: Output,
    stack: ExitStack,
) -> None:
    """Answer other terminals on this host; if that fails, they query the nodes instead."""
    if folder is None:
        return
    # Not at the top: this is loaded while the nodes' processes start.
    from obk_cli.introspect.graph_source import GraphService
    from obk_cli.launch.control_server import serve_control

    try:
        stack.enter_context(serve_control(folder, inbox.put, GraphService(ros.participant()).ask))
    except OSError as error:
        output.note(f"warning: other terminals cannot reach this launch: {error}")


def _commands(
    units: tuple[Unit, ...],
    executables: Executables,
    folder: Path | None,
    variables: Mapping[str, str],
    packages: PackageIndex,
    output: Output,
    stack: ExitStack,
) -> tuple[Mapping[str, NodeCommand], Mapping[str, str]]:
    """The processes' commands, and the environment that they have in common.

    If the run's folder is not writable, the files of the commands go into another folder.
    """

    def commands_in(folder: Path) -> tuple[Mapping[str, NodeCommand], Mapping[str, str]]:
        prefix = folder / "prefix"
        stack.callback(rmtree, prefix, ignore_errors=True)
        common = with_prefix(variables, make_share_prefix(prefix, packages))
        return unit_commands(units, executables, folder, common), common

    if folder is not None:
        try:
            return commands_in(folder)
        except OSError as error:
            output.unwritable(error)
    try:
        return commands_in(Path(stack.enter_context(TemporaryDirectory(prefix="obk-"))))
    except OSError as error:
        raise CommandFailedError(f"the parameters cannot be written: {error}") from error


def _requesting_end(
    inbox: "SimpleQueue[InputEvent]", duration_s: float | None
) -> Callable[[], None]:
    def request() -> None:
        inbox.put(StopRequested(reason=f"after {duration_s:g} s of simulated time"))

    return request


def _requesting_stop(inbox: "SimpleQueue[InputEvent]") -> Callable[[signal.Signals], None]:
    def request(number: signal.Signals) -> None:
        # A closing terminal sends SIGHUP more than once, which must not force the stop.
        inbox.put(StopRequested(reason=number.name, is_urgent=number != signal.SIGHUP))

    return request
