"""Compile a config and load the programs of its nodes, to create nodes for each trial.

The programs are nested, as in a composed process, and each runs up to its call to `spin_obelisk`.
They stay there, on a separate thread, until the process ends. Every trial creates new nodes
from their spin requests, so no attribute of a node passes from one trial to the next.
"""

import copy
import ctypes
import gc
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import rclpy
from rclpy.signals import SignalHandlerOptions

from obelisk_py.core.composition import (
    Program,
    logger_name,
    ros_arguments_of,
    set_log_levels,
)
from obelisk_py.core.lifecycle import node_arguments
from obelisk_py.core.lockstep.interception import refuse_plain_nodes, repeatable_import
from obelisk_py.core.spinning import SpinRequest, spin_requests_served_by
from obelisk_spec.values import ParameterValue
from obk_cli.compiler import Options, compile_config
from obk_cli.config.environment import Environment
from obk_cli.config.model import refuse_hardware
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import COMMAND_LINE
from obk_cli.emit.params import emit_params, params_file_name
from obk_cli.errors import CommandFailedError
from obk_cli.launch.commands import find_executables, is_composable, ros_arguments
from obk_cli.plan.plan import Plan, PlannedNode
from obk_cli.report import report_text
from obk_cli.ros.environment import RANGE
from obk_cli.workspace.package_index import PackageIndex
from obk_testing.module_generators import ModuleGenerators

__all__ = [
    "CompiledStack",
    "LoadedNode",
    "LoadedStack",
    "LoadedStacks",
    "compile_stack",
    "find_node",
    "load_stack",
]

_TRIALS_OF_A_PARTICIPANT: Final = 20
_LOAD_S: Final = 120.0
"""Limit for all programs to call `spin_obelisk` [s]; a large neural network may load slowly."""
_NOT_FOR_TESTS: Final = {"viewer": "none", "render": ""}
"""Simulator parameters that open windows or write files, with values that disable them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CompiledStack:
    """A config that can run in lockstep."""

    config: Path
    plan: Plan
    packages: PackageIndex
    environment: Environment | None
    """The packages and models found during compilation."""
    unclear_robots: frozenset[str] = frozenset()
    """Full names of robots for which the config does not specify whether they are hardware."""
    left_out: tuple[PlannedNode, ...] = ()
    """Nodes of the config that are not in the plan; stubs may publish their topics."""
    places: Mapping[str, str]
    """Full name of a node -> its path in the config, `control[0]`."""
    warnings: tuple[Diagnostic, ...] = ()
    """Warnings about the overrides."""


def compile_stack(
    config: Path,
    overrides: Sequence[str] = (),
    *,
    without: Iterable[str] = (),
    environment: Environment | None = None,
) -> CompiledStack:
    """Compile a config for tests.

    Args:
        config: path of the config.
        overrides: `path=value`, as for `--set`.
        without: full names of nodes to leave out.
        environment: from an earlier compilation of the same config, to save time.

    Raises:
        CommandFailedError: the config has errors, its robot is hardware, or a node cannot run in
            lockstep.
    """
    options = Options(
        variables=dict(os.environ),
        working_folder=Path.cwd(),
        overrides=tuple(overrides),
        environment=environment,
    )
    outcome = compile_config(str(config), options)
    if outcome.plan is None or outcome.config is None:
        errors = tuple(each for each in outcome.diagnostics if each.severity == "error")
        raise CommandFailedError(
            f"{config} has errors\n{report_text(errors, colour=False)}",
            help=f"run `obk validate {config}` to see them",
        )
    left_out = _full_names(outcome.plan, without)
    # A robot of an unspecified kind may be a custom simulator. The class of its node decides,
    # before the node is configured.
    refuse_hardware(
        outcome.config,
        "tests never access hardware",
        help="select a variant with a simulated robot, or override it: "
        "set=['robot[0].is_simulated=true']",
        may_be_unclear=True,
        left_out=left_out,
    )
    nodes = tuple(each for each in outcome.plan.nodes if each.full_name not in left_out)
    packages = PackageIndex.around(config.parent, Path.cwd(), dict(os.environ))
    unclear = frozenset(
        robot.full_name
        for robot in outcome.config.section("robot")
        if robot.is_simulated is None and not robot.runs_simulation
    )
    return CompiledStack(
        config=config,
        plan=replace(outcome.plan, nodes=nodes),
        packages=packages,
        environment=outcome.environment,
        unclear_robots=unclear,
        left_out=tuple(each for each in outcome.plan.nodes if each.full_name in left_out),
        places={node.full_name: f"{node.section}[{node.index}]" for node in outcome.config.nodes},
        warnings=tuple(
            finding
            for finding in outcome.diagnostics
            if finding.severity == "warning" and finding.span.path == COMMAND_LINE
        ),
    )


def _full_names(plan: Plan, names: Iterable[str]) -> set[str]:
    return {find_node(plan, name).full_name for name in names}


def find_node(plan: Plan, name: str) -> PlannedNode:
    """Find a node by its full name, its name, or a section with only one node.

    Raises:
        LookupError: no node matches, or several do.
    """
    found = [each for each in plan.nodes if name in (each.full_name, each.node, each.section)]
    if len(found) != 1:
        names = ", ".join(f"{each.full_name} ({each.section})" for each in plan.nodes)
        reason = "several nodes match" if found else "no node matches"
        raise LookupError(f"{reason} `{name}`; nodes: {names}")
    return found[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedNode:
    """A node that can be created."""

    planned: PlannedNode
    program: Program
    request: SpinRequest

    def make(self) -> Any:
        """Create the node in the current surroundings."""
        arguments = ros_arguments_of(self.request.args)
        set_log_levels(logger_name(self.program.node), arguments)
        with self.program.command_line(), node_arguments(arguments):
            return self.request.make()

    def with_parameters(self, planned: PlannedNode, old: str, new: str) -> "LoadedNode":
        """Return the same program with another parameter file."""
        program, request = self.program, self.request
        return replace(
            self,
            planned=planned,
            program=replace(program, arguments=_replaced(program.arguments, old, new)),
            request=replace(request, args=_replaced(request.args, old, new)),
        )


def _replaced(arguments: Sequence[str], old: str, new: str) -> tuple[str, ...]:
    return tuple(new if argument == old else argument for argument in arguments)


class Participant:
    """This process's DDS participant, whose creation takes longer than that of a trial's nodes.

    Its memory grows with every node, so it is replaced periodically.
    """

    def __init__(self) -> None:
        """Start without a participant."""
        self._stacks = self._trials = self._trials_since = 0
        self._owns_context = False
        self._keeper: Any = None

    def open(self) -> None:
        """Create the participant for the first stack."""
        if not rclpy.ok():
            before = os.environ.get(RANGE)
            os.environ[RANGE] = "OFF"  # hides the nodes from other processes
            try:
                rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            finally:
                if before is None:
                    del os.environ[RANGE]
                else:
                    os.environ[RANGE] = before
            self._owns_context = True
        self._stacks += 1
        if self._keeper is None:
            self._make()

    def close(self) -> None:
        """Destroy the participant after the last stack."""
        self._stacks -= 1
        if self._stacks == 0:
            self._destroy()
            if self._owns_context:
                rclpy.try_shutdown()
            self._owns_context = False

    def enter(self) -> None:
        """Keep the participant during a trial."""
        self._trials += 1
        self._trials_since += 1

    def leave(self) -> None:
        """End a trial, and replace the participant if due."""
        self._trials -= 1
        is_due = self._trials_since >= _TRIALS_OF_A_PARTICIPANT
        if self._trials == 0 and is_due and self._keeper is not None:
            self._destroy()
            _return_memory()
            self._make()

    def _make(self) -> None:
        # rcl creates the participant with its first node, and destroys it with the last.
        self._keeper = rclpy.create_node(
            "obk_test", start_parameter_services=False, enable_rosout=False
        )
        self._trials_since = 0

    def _destroy(self) -> None:
        self._keeper.destroy_node()
        self._keeper = None
        gc.collect()


def _return_memory() -> None:
    """Return freed memory to the system, if the C library is glibc."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


_participant: Final = Participant()
"""One per process, like rclpy's context."""


class LoadedStack:
    """The loaded programs of a config, which create the nodes of its trials."""

    def __init__(self, compiled: CompiledStack) -> None:
        """Import the programs, and run each one up to its `spin_obelisk`.

        Raises:
            CommandFailedError: a program is missing, is not a Python program for this interpreter,
                returns without calling `spin_obelisk`, or imports messages that are not compiled.
        """
        self.plan = compiled.plan
        self.config = compiled.config
        self.environment = compiled.environment
        self.left_out = compiled.left_out
        self.places = compiled.places
        self.warnings = compiled.warnings
        self._is_variant = False
        self.participant = _participant
        self.unclear_robots = compiled.unclear_robots
        self.nodes: list[LoadedNode] = []
        self._ready, self._over = threading.Event(), threading.Event()
        self._error: BaseException | None = None
        self._loading = ""
        """The node and program that was started last."""
        self._thread: threading.Thread | None = None
        self._resources = ExitStack()
        with ExitStack() as failed:
            failed.callback(self.close)
            self._load(compiled)
            failed.pop_all()
        gc.collect()
        gc.freeze()  # excludes the loaded objects from later collections

    def _load(self, compiled: CompiledStack) -> None:
        self.participant.open()
        self._resources.callback(self.participant.close)
        programs = self._programs(compiled)
        arguments, modules = sys.argv, frozenset(sys.modules)
        self._thread = threading.Thread(
            target=self._run_all, args=[programs], name="programs", daemon=True
        )
        try:
            with refuse_plain_nodes():
                self._thread.start()
                if not self._ready.wait(_LOAD_S):
                    raise CommandFailedError(
                        f"{self._loading} has not called spin_obelisk within {_LOAD_S:g} s",
                        help="look for a loop, a wait or input() in its `main`",
                    )
        finally:
            sys.argv = arguments  # each program has set its own
        # A test may have imported modules of the nodes before.
        packages = {program.module.partition(".")[0] for _, program in programs}
        self.generators = ModuleGenerators(
            name
            for name in [*sys.modules]
            if name not in modules or name.partition(".")[0] in packages
        )
        if self._error is not None:
            missing = getattr(self._error, "name", None)
            if isinstance(self._error, ModuleNotFoundError) and (
                missing in compiled.packages.message_packages()
            ):
                raise CommandFailedError(
                    f"{self._loading}: the message package `{missing}` is not compiled",
                    help="run `obk build`",
                )
            raise self._error

    def close(self) -> None:
        """Let the programs end, and release all resources."""
        self._over.set()
        if self._thread is not None:
            self._thread.join(5.0)
        self._resources.close()

    def with_parameters(self, compiled: CompiledStack) -> "LoadedStack":
        """Return the same programs with other parameters, until this stack is closed.

        Args:
            compiled: its plan may differ from the plan of this stack only in parameters.
        """
        other = copy.copy(self)
        other.plan, other.warnings = compiled.plan, compiled.warnings
        other._is_variant = True
        other._folder = Path(tempfile.mkdtemp(dir=self._folder))
        nodes = {node.full_name: node for node in compiled.plan.nodes}
        other.nodes = [
            node.with_parameters(
                nodes[node.planned.full_name],
                str(self._folder / params_file_name(node.planned)),
                str(_write_parameters(nodes[node.planned.full_name], other._folder)),
            )
            for node in self.nodes
        ]
        return other

    def remove_parameters(self) -> None:
        """Remove the files of `with_parameters`; no node can be created afterwards."""
        if self._is_variant:
            shutil.rmtree(self._folder)

    def _programs(self, compiled: CompiledStack) -> list[tuple[PlannedNode, Program]]:
        nodes = compiled.plan.nodes
        executables = find_executables(nodes, compiled.packages)
        for node in nodes:
            if not is_composable(replace(node, env={}), executables[node.full_name]):
                raise CommandFailedError(
                    f"{node.origin}: {node.full_name} ({node.package}/{node.executable}) is not a "
                    "Python lifecycle node for this interpreter, so it cannot run in lockstep",
                    help=f"leave it out, stack(..., without=['{node.full_name}']), and replace it "
                    "with `stub`",
                )
        # Parameters may be secret, so the folder is private to this user.
        self._folder = Path(
            self._resources.enter_context(tempfile.TemporaryDirectory(prefix="obk-test-"))
        )
        programs = []
        for tier in compiled.plan.tiers:
            for node in tier:
                command = executables[node.full_name]
                new = [str(path) for path in command.python_path if str(path) not in sys.path]
                sys.path[:0] = new
                path = _write_parameters(node, self._folder)
                assert command.module is not None
                program = Program(
                    node=node.full_name,
                    module=command.module,
                    function=command.function,
                    arguments=tuple(ros_arguments(node, path)),
                )
                programs.append((node, program))
        return programs

    def _run_all(self, programs: list[tuple[PlannedNode, Program]]) -> None:
        try:
            with repeatable_import():
                self._run(programs)
        except BaseException as error:
            self._error = error
        self._ready.set()

    def _run(self, programs: list[tuple[PlannedNode, Program]]) -> None:
        """Run the first program, and the others within its call to `spin_obelisk`."""
        if not programs:
            self._ready.set()
            self._over.wait()
            return
        (node, program), *others = programs
        self._loading = f"{node.full_name}: {program}"
        before = len(self.nodes)

        def take(request: SpinRequest) -> int:
            if len(self.nodes) == before:
                self.nodes.append(LoadedNode(planned=node, program=program, request=request))
                self._run(others)
            return 0

        try:
            with spin_requests_served_by(take):
                program.run()
        except SystemExit:
            pass
        if len(self.nodes) == before:
            raise CommandFailedError(
                f"{node.full_name}: {program} ended without calling spin_obelisk"
            )


def _write_parameters(node: PlannedNode, folder: Path) -> Path:
    path = folder / params_file_name(node)
    path.write_text(emit_params((_for_tests(node),)), encoding="utf-8")
    return path


def _for_tests(node: PlannedNode) -> PlannedNode:
    if not node.model:
        return node
    parameters: Mapping[str, ParameterValue] = {**node.parameters, **_NOT_FOR_TESTS}
    return replace(node, parameters=parameters)


def load_stack(
    config: Path, overrides: Sequence[str] = (), *, without: Iterable[str] = ()
) -> LoadedStack:
    """Compile and load a config; for arguments and errors see `compile_stack`."""
    return LoadedStack(compile_stack(config, overrides, without=without))


_MOST_VARIANTS: Final = 8
"""Number of loaded stacks that are kept between two tests."""


class LoadedStacks:
    """The stacks of a session; variants of a config with different parameters share programs."""

    def __init__(self) -> None:
        self._programs: list[tuple[Path, tuple[str, ...], LoadedStack]] = []
        """Config, omitted nodes, and the stack, in the order of loading."""
        self._variants: dict[tuple[Path, tuple[str, ...], tuple[str, ...]], LoadedStack] = {}

    def get(
        self, config: Path, overrides: Sequence[str] = (), *, without: Iterable[str] = ()
    ) -> LoadedStack:
        """Return a stack, loading it if necessary; for arguments and errors see `compile_stack`."""
        key = (config, tuple(without), tuple(overrides))
        if key in self._variants:
            return self._variants[key]
        loaded = [stack for *of, stack in self._programs if tuple(of) == key[:2]]
        environment = loaded[0].environment if loaded else None
        compiled = compile_stack(config, overrides, without=key[1], environment=environment)
        bare = _without_parameters(compiled.plan)
        same = (stack for stack in loaded if _without_parameters(stack.plan) == bare)
        stack = next(same, None)
        if stack is None:
            stack = LoadedStack(compiled)
            self._programs.append((*key[:2], stack))
        else:
            stack = stack.with_parameters(compiled)
        self._variants[key] = stack
        return stack

    def trim(self) -> None:
        """Release the oldest stacks; none of their trials may be running."""
        if len(self._variants) <= _MOST_VARIANTS:
            return
        for stack in self._variants.values():
            stack.remove_parameters()
        self._variants = {}
        # The first one is kept, because most variants share its programs.
        for *_, stack in self._programs[1:]:
            stack.close()
        del self._programs[1:]

    def close(self) -> None:
        """Let the programs of all stacks end."""
        self._variants.clear()
        for *_, stack in self._programs:
            stack.close()
        self._programs.clear()


def _without_parameters(plan: Plan) -> Plan:
    nodes = tuple(replace(node, parameters={}) for node in plan.nodes)
    return replace(plan, nodes=nodes)
