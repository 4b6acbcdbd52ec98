"""`obk new ... --add-to CONFIG`: add the new node to a config.

The edit is planned first and written last: if the config cannot take the node, nothing is created.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from obelisk_spec.names import bare_name
from obk_cli.cli.config_options import make_options, print_findings
from obk_cli.cli.new_run import AddToOptions
from obk_cli.compiler import Outcome, compile_source
from obk_cli.config.environment import ModelRead
from obk_cli.config.model import Node
from obk_cli.configedit.add_node import add_node, find_replaced, new_errors
from obk_cli.configedit.auto_wiring import matching_types
from obk_cli.configedit.edited_files import EditedFile, open_for_edit, report_diff, write_edited
from obk_cli.configedit.new_node import Rejected, read_new_node
from obk_cli.configedit.report import AddedNode, added_lines, added_values
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import SourceFile
from obk_cli.errors import CommandFailedError
from obk_cli.launch.commands import composable, find_executables
from obk_cli.scaffold.describe import Added
from obk_cli.scaffold.kinds import SECTIONS, Kind
from obk_cli.scaffold.package_spec import MessageType, PackageRequest, PackageSpec, RobotJoints
from obk_cli.scaffold.robot_model import robot_joints
from obk_cli.scaffold.variables import TestedStack, config_snippet
from obk_cli.workspace.package_index import PackageIndex

__all__ = ["OpenConfig", "open_config"]


_KEYFRAME = "ic_keyframe"
_USUAL_KEYFRAME = "ic"
"""The keyframe at which the simulator starts by default."""
_OPTIONS: Mapping[str, str] = {
    "ctrl": "--ctrl-msg",
    "est": "--est-msg",
    "sensor": "--sensor-msg",
}
"""The option for the message type of `pub_ctrl`, `sub_ctrl` and so on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfigEdit:
    """A config's new text, not yet written."""

    added: AddedNode
    _file: EditedFile
    _before: Outcome
    """Outcome for the unedited config."""
    _is_built_later: bool
    """Whether the node's executable exists only after a build."""

    def write(self) -> None:
        """Replace the config once the package exists, if the config has no new errors.

        Raises:
            CommandFailedError: the config has new errors, or the file has changed or cannot be
                written.
        """
        if not self._is_built_later:
            source = SourceFile.of(self.added.source.path, self.added.text)
            after = compile_source(source, make_options(None, None)).diagnostics
            errors = new_errors(self.added.before, after)
            if errors:
                print_findings(errors)
                raise CommandFailedError(
                    f"adding the node would cause new errors in `{source.path}`; nothing was "
                    "created",
                    help="see the errors above",
                )
        write_edited(self._file, self.added.text)

    def tested_stack(self, kind: Kind, folder: Path) -> TestedStack | None:
        """The stack for the test of the new node.

        Args:
            kind: of the node.
            folder: where the test will be.

        Returns:
            None if the stack cannot run in lockstep: it drives a real robot, or a node does not
            run in this Python interpreter.
        """
        published = [link.topic for link in self.added.links if link.end.direction == "publishes"]
        outcome = self._before
        if kind == "robot" or self._is_built_later or not published or outcome.config is None:
            return None
        simulated = [robot.is_simulated for robot in outcome.config.section("robot")]
        if outcome.plan is None or any(each and not each.value for each in simulated):
            return None
        config, nodes = Path(self.added.source.path).resolve(), outcome.plan.nodes
        packages = PackageIndex.around(config.parent, Path.cwd(), os.environ)
        try:
            executables = find_executables(nodes, packages)
        except CommandFailedError:
            return None
        if len(composable(nodes, executables)) < len(nodes):
            return None
        return TestedStack(
            config=os.path.relpath(config, folder.resolve()), topic=sorted(published)[0]
        )

    def describe(self, *, is_done: bool) -> Added:
        """Describe what was, or would be, changed in the config."""
        source, text = self.added.source, self.added.text
        later = "note: until it is built, `obk validate` reports a missing executable"
        return Added(
            config=source.path,
            is_connected=not self.added.unpublished,
            lines=(
                *added_lines(self.added, is_done=is_done),
                *((later,) if self._is_built_later else ()),
            ),
            values=added_values(self.added),
            diff=report_diff(source, text, colour=False),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenConfig:
    """The config that a node is to be added to, compiled once."""

    options: AddToOptions
    _file: EditedFile
    _outcome: Outcome

    def with_types(self, request: PackageRequest, default: PackageSpec) -> PackageRequest:
        """The request with open message types filled in from the config.

        `default` holds the types otherwise used. `add` reports errors in the config.
        """
        stack, replaces = self._outcome.config, self.options.replaces
        if stack is None:
            return request
        new_node = read_new_node(SECTIONS[default.kind], config_snippet(default))
        replaced = find_replaced(stack, new_node.section, replaces) if replaces else None
        if isinstance(replaced, Rejected):
            return request
        types = {
            component.partition("_")[2]: full
            for component, full in matching_types(new_node, stack, replaced).items()
        }
        return replace(
            request,
            ctrl_msg=request.ctrl_msg or types.get("ctrl"),
            est_msg=request.est_msg or types.get("est"),
            sensor_msg=request.sensor_msg or types.get("sensor"),
        )

    def robot_joints(self, sensor: MessageType) -> RobotJoints | None:
        """The joints of the simulated robot to be replaced, or of the stack's only one.

        Args:
            sensor: the message of its encoders.

        Returns:
            None if there is no such robot, or its model cannot be read.
        """
        stack, environment = self._outcome.config, self._outcome.environment
        if stack is None or environment is None:
            return None
        replaces = self.options.replaces
        replaced = find_replaced(stack, SECTIONS["robot"], replaces) if replaces else None
        robots = (replaced,) if isinstance(replaced, Node) else stack.section(SECTIONS["robot"])
        simulated = [(robot, sim) for robot in robots for sim in robot.used_sims]
        if len(simulated) != 1:
            return None
        ((robot, sim),) = simulated
        path = sim.model.found if sim.model else None
        read = environment.read_model(path) if path else None
        if not isinstance(read, ModelRead):
            return None
        keyframe = next((p.value for p in robot.params if p.name == _KEYFRAME), _USUAL_KEYFRAME)
        return robot_joints(read.facts, str(keyframe), self._encoders(robot, sensor))

    def _encoders(self, robot: Node, sensor: MessageType) -> tuple[str, ...]:
        """The sensors with which a simulated robot fills a message."""
        nodes = self._outcome.plan.nodes if self._outcome.plan else ()
        groups = (
            group
            for node in nodes
            if node.full_name == robot.full_name
            for group in node.sensor_groups
            if bare_name(group.kind) == sensor.name
        )
        return tuple(next((group.sensors for group in groups), ()))

    def add(self, spec: PackageSpec) -> ConfigEdit:
        """The edit that puts the new node into the config; nothing is written.

        Raises:
            CommandFailedError: the config cannot take the node.
        """
        added = add_node(
            self._file.source,
            read_new_node(SECTIONS[spec.kind], config_snippet(spec)),
            make_options(None, None),
            before=self._outcome,
            device=self.options.device,
            replaces=self.options.replaces,
        )
        if isinstance(added, Rejected):
            raise _failure(added)
        return ConfigEdit(
            added=added,
            _file=self._file,
            _before=self._outcome,
            _is_built_later=spec.language == "cpp",
        )


def open_config(options: AddToOptions) -> OpenConfig:
    """Read and compile the config that a node is to be added to.

    Raises:
        CommandFailedError: the config cannot be read.
    """
    file = open_for_edit(options.config)
    if isinstance(file, Diagnostic):
        print_findings((file,))
        raise CommandFailedError(f"`{options.config}` cannot be read; nothing was created")
    outcome = compile_source(file.source, make_options(None, None))
    return OpenConfig(options=options, _file=file, _outcome=outcome)


def _failure(rejected: Rejected) -> CommandFailedError:
    print_findings(rejected.findings)
    option = _OPTIONS.get((rejected.component or "").partition("_")[2])
    help = f"{rejected.help} with `{option}`" if option else rejected.help
    if rejected.snippet:
        help = f"{help}:\n{rejected.snippet}"
    return CommandFailedError(f"{rejected.sentence}; nothing was created", help=help)
