"""Runs a plan on this machine until it ends by itself, by a signal or by a failure.

The library entry behind `obk launch`. Takes a plan, gives how the run ended. Runs on without log
files where they cannot be written, and never waits for whoever reads the screen.
"""

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory

from obk_cli.adapters.clock import monotonic_s
from obk_cli.adapters.control_socket import serve_control
from obk_cli.adapters.end_signals import end_signals_heard
from obk_cli.adapters.leftovers import launch_marks
from obk_cli.adapters.packages import PackageIndex
from obk_cli.adapters.processes import NodeCommand, WardenProcesses
from obk_cli.adapters.ros_answers import RosAnswers
from obk_cli.adapters.ros_environment import RosEnvironment
from obk_cli.adapters.ros_lifecycle import RosLifecycle, open_ros
from obk_cli.adapters.shared_memory import remove_dead_segments
from obk_cli.adapters.state_node import StateNode, state_node_name
from obk_cli.errors import CommandFailedError
from obk_cli.launch.events import Ended, Heard, StackState, StopAsked, Told
from obk_cli.launch.supervisor import Supervisor
from obk_cli.launch.units import Unit, units_of
from obk_cli.plan.plan import Plan
from obk_cli.running.claim import claimed
from obk_cli.running.commands import Executables, composable, find_executables, unit_commands
from obk_cli.running.early import early_units, gate_variables, held_at_gate
from obk_cli.running.film import Film
from obk_cli.running.neighbours import looking_on, refuse_strangers, refuse_taken_names
from obk_cli.running.options import LaunchOptions
from obk_cli.running.other_types import other_types_told
from obk_cli.running.output import Output
from obk_cli.running.recorder import Recorder
from obk_cli.running.surface import Surface

__all__ = ["run_plan"]


def run_plan(
    plan: Plan,
    packages: PackageIndex,
    environment: RosEnvironment,
    options: LaunchOptions,
    surface: Surface,
) -> Ended:
    """Run a plan until it ends by itself, by a signal or by a failure.

    Args:
        plan: what to run.
        packages: where the executables are.
        environment: of the ROS processes.
        options: what of it, how far, how long.
        surface: shows what happens; when nobody reads it any more the stack is brought down.

    Raises:
        CommandFailedError: an executable is missing, the stack or one of its nodes runs already,
            somebody else moves the robot, ROS does not start, or no folder takes the parameters.
    """
    inbox, share = SimpleQueue[Heard](), options.share
    executables, units = _units(plan, packages, options)
    with ExitStack() as stack:
        stack.enter_context(end_signals_heard(_asking_for_the_end(inbox)))
        stack.callback(remove_dead_segments)
        surface.screen.when_closed(lambda: inbox.put(StopAsked(reason="the output was closed")))
        claim = stack.enter_context(claimed(plan, environment, options))
        voice = surface.voice(plan, units, leads=share.leads)
        output = stack.enter_context(Output(claim.folder, surface.screen, voice, units))
        claim.tell(output)
        marks = launch_marks(claim.folder)
        variables = {**environment.variables, **marks, **gate_variables(claim.folder)}
        commands = _commands(units, executables, claim.folder, variables, output, stack)
        recorder = Recorder(options.recording, claim.folder, output)
        film = Film(plan, share, output)
        # Before ROS is there: its threads have no business in the warden's fork.
        processes = stack.enter_context(
            WardenProcesses(
                commands={**commands, **recorder.commands(variables)},
                folder=options.folder,
                marks=marks,
                hear=recorder.hearing(inbox.put),
                on_line=recorder.lines(film.lines(output.line)),
            )
        )
        recorder.start(processes)
        with held_at_gate(claim.folder, early_units(units, executables, options.spun), processes):
            ros = stack.enter_context(open_ros("obk_launch", environment))
            stack.enter_context(_alone(plan, units, ros, environment, options, inbox))
        _join_nodes(ros, plan, units, inbox, output if share.leads else None)
        _mind_others(plan, claim.folder, ros, inbox, output, stack)
        supervisor = Supervisor(
            plan,
            units=units,
            processes=processes,
            lifecycle=ros,
            inbox=inbox,
            clock=monotonic_s,
            tell=recorder.telling(film.telling(output.event)),
            limits=options.limits,
            on_crash=options.on_crash,
            strict_rates=options.strict_rates,
            lead=None if share.leads else _state_node(plan),
        )
        recorder.wait_until_begun()
        claim.ended = supervisor.run(options.until, options.duration_s)
        return claim.ended


def _units(
    plan: Plan, packages: PackageIndex, options: LaunchOptions
) -> tuple[Executables, tuple[Unit, ...]]:
    """The programs of the nodes that run here, and the processes that they run in."""
    here = [node for node in plan.processes if node.device in options.share.devices]
    executables = find_executables(here, packages)
    together = composable(here, executables) if options.is_composed else frozenset[str]()
    return executables, units_of(plan, devices=options.share.devices, together=together)


@contextmanager
def _alone(
    plan: Plan,
    units: tuple[Unit, ...],
    ros: RosLifecycle,
    environment: RosEnvironment,
    options: LaunchOptions,
    inbox: "SimpleQueue[Heard]",
) -> Iterator[None]:
    """Make sure that nobody has the stack's names, nor its robot."""
    own = [_state_node(plan)] if options.share.leads else []
    names = (*own, *(name for unit in units for name in unit.node_names))
    refuse_taken_names(names, ros, environment.domain)
    if options.allows_foreign:
        yield
        return
    refuse_strangers(plan, ros, environment.domain)
    with looking_on(plan, ros, inbox.put):
        yield


def _state_node(plan: Plan) -> str:
    return f"/{state_node_name(plan.name)}"


def _join_nodes(
    ros: RosLifecycle,
    plan: Plan,
    units: tuple[Unit, ...],
    inbox: "SimpleQueue[Heard]",
    leader: Output | None,
) -> None:
    """Hear what nodes answer, and of the rates of those that run here.

    Where this launch leads, the state node is offered, and shows what `leader` is told.
    """
    ros.listen(inbox.put)
    ros.listen_to_rates(name for unit in units for name in unit.node_names)
    if leader is not None:
        leader.also_to(_shown_by(StateNode(ros, plan.name, inbox.put, leader.note)))


def _shown_by(node: StateNode) -> Callable[[Told], None]:
    def show(event: Told) -> None:
        if isinstance(event, StackState):
            node.show(event.state)

    return show


def _mind_others(
    plan: Plan,
    folder: Path | None,
    ros: RosLifecycle,
    inbox: "SimpleQueue[Heard]",
    output: Output,
    stack: ExitStack,
) -> None:
    """Tell of nodes that have other message types, and answer other terminals."""
    stack.enter_context(other_types_told(plan, ros.graph, output.note))
    _serve_others(folder, ros, inbox, output, stack)


def _serve_others(
    folder: Path | None,
    ros: RosLifecycle,
    inbox: "SimpleQueue[Heard]",
    output: Output,
    stack: ExitStack,
) -> None:
    """Answer other terminals of this host; where that cannot be they ask the nodes."""
    if folder is None:
        return
    try:
        stack.enter_context(serve_control(folder, inbox.put, RosAnswers(ros.look()).ask))
    except OSError as error:
        output.note(f"warning: other terminals are not answered: {error}")


def _commands(
    units: tuple[Unit, ...],
    executables: Executables,
    folder: Path | None,
    variables: Mapping[str, str],
    output: Output,
    stack: ExitStack,
) -> Mapping[str, NodeCommand]:
    """The processes' commands; where the run's folder takes no files, with those in another one."""
    if folder is not None:
        try:
            return unit_commands(units, executables, folder, variables)
        except OSError as error:
            output.unwritable(error)
    try:
        temporary = stack.enter_context(TemporaryDirectory(prefix="obk-"))
        return unit_commands(units, executables, Path(temporary), variables)
    except OSError as error:
        raise CommandFailedError(f"the parameters cannot be written: {error}") from error


def _asking_for_the_end(inbox: "SimpleQueue[Heard]") -> Callable[[signal.Signals], None]:
    def ask(number: signal.Signals) -> None:
        # A closing terminal sends SIGHUP more than once, and nobody's impatience.
        inbox.put(StopAsked(reason=number.name, is_urgent=number != signal.SIGHUP))

    return ask
