"""Write the parameters of running nodes into their config: find the edit, show it, write it.

Used by `obk param save` and `obk web`.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from obelisk_spec.values import ParameterValue
from obk_cli.compiler import Options, compile_config
from obk_cli.configedit.edited_files import EditedFile, open_for_edit, report_diff, write_edited
from obk_cli.configedit.save_params import SavedParameter, save_parameters
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.emit.params import emit_value
from obk_cli.errors import CommandFailedError
from obk_cli.introspect.graph_source import open_graph, parameters_of
from obk_cli.introspect.resolve import settle
from obk_cli.introspect.target import GraphTarget
from obk_cli.introspect.tuning import tunable
from obk_cli.plan.plan import Plan
from obk_cli.ros.parameters import NodeParameter
from obk_cli.terminal import plain

__all__ = ["ConfigUpdate", "find_update", "write_update"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfigUpdate:
    """The edits that would save running nodes' parameters in the config; nothing is written yet."""

    config: str
    findings: tuple[Diagnostic, ...]
    """Errors in the current config; if there are any, nothing can be written."""
    parameters: tuple[SavedParameter, ...]
    """Parameters that differ, including those that cannot be written."""
    files: tuple[tuple[EditedFile, str], ...]
    """Every changed file, with its new text."""
    missing_nodes: tuple[str, ...]
    """Full names of the config's nodes that are not running."""

    def diff(self, *, colour: bool = False) -> str:
        """The edit as a unified diff; empty if nothing changes."""
        return "".join(report_diff(file.source, text, colour=colour) for file, text in self.files)

    def changes(self) -> Iterator[str]:
        """A sentence for each value that is written, with its location."""
        for one in self.parameters:
            if not one.fault:
                yield f"{one.place.path}:{one.place.line}: {_change(one)}"

    def faults(self) -> Iterator[str]:
        """A sentence for each value that cannot be written, with the reason."""
        for one in self.parameters:
            if one.fault:
                yield f"{one.place}: {_change(one)}: {one.fault}"


def find_update(
    config: str, options: Options, target: GraphTarget, timeout_s: float
) -> ConfigUpdate:
    """Compare a config with its running nodes.

    Args:
        config: the path of the config.
        options: how to compile it.
        target: where its nodes run.
        timeout_s: limit for each answer from a node [s].

    Raises:
        CommandFailedError: none of its nodes is running, one runs another program or does not
            answer, or a file cannot be read.
    """
    outcome = compile_config(config, options)
    declared = outcome.config
    if outcome.plan is not None:
        _require_same_programs(config, outcome.plan, target.plans)
    wanted = {
        node.full_name: frozenset(parameter.name for parameter in node.params)
        for node in (declared.nodes if declared else ())
    }
    values = _present_values(wanted, target, timeout_s) if wanted else {}
    saved = save_parameters(config, options, values)
    return ConfigUpdate(
        config=config,
        findings=saved.findings,
        parameters=saved.parameters,
        files=tuple((_opened(source.path), text) for source, text in saved.files),
        missing_nodes=tuple(sorted(wanted.keys() - values.keys())),
    )


def write_update(update: ConfigUpdate) -> None:
    """Write the files.

    Raises:
        CommandFailedError: a file has changed since it was read, or cannot be written.
    """
    for file, text in update.files:
        write_edited(file, text)


def _require_same_programs(config: str, plan: Plan, running: Iterable[Plan]) -> None:
    """Reject the config of another stack; nodes have the same default names in every config."""
    programs = {node.full_name: f"{node.package}/{node.executable}" for node in plan.nodes}
    for node in (node for one in running for node in one.nodes):
        program = f"{node.package}/{node.executable}"
        if programs.get(node.full_name, program) != program:
            raise CommandFailedError(
                f"`{config}` is not the config of the running stack: {node.full_name} is "
                f"{program}, but {programs[node.full_name]} in this config",
                help="name the config that was launched",
            )


def _present_values(
    wanted: Mapping[str, frozenset[str]], target: GraphTarget, timeout_s: float
) -> dict[str, dict[str, ParameterValue]]:
    """The running nodes' values of all parameters that are in the config or have been tuned."""
    found: dict[str, dict[str, ParameterValue]] = {}
    with open_graph(target, None, asks_nodes=True) as source:
        settle(source, target, timeout_s)
        for node in sorted(wanted.keys() & set(source.nodes())):
            parameters = parameters_of(source, node, timeout_s)
            known = frozenset(parameters.names())
            present = parameters.values(sorted(wanted[node] & known)) if wanted[node] else {}
            values: dict[str, NodeParameter] = {
                **present,
                **{
                    one.name: one.value
                    for one in tunable(parameters)
                    if one.name not in wanted[node]
                    and one.value.value != one.description.notes.initial
                },
            }
            found[node] = {name: one.value for name, one in values.items() if one.value is not None}
    if not found:
        raise CommandFailedError(
            "no node in the config is running", help="start the stack with `obk launch`"
        )
    return found


def _opened(path: str) -> EditedFile:
    file = open_for_edit(path)
    if isinstance(file, Diagnostic):
        raise CommandFailedError(f"`{path}` cannot be read; nothing was written")
    return file


def _change(one: SavedParameter) -> str:
    new = plain(emit_value(one.after))
    if one.before is None:
        return f"{one.node}: {one.name} added: {new}"
    return f"{one.node}: {one.name} changed from {plain(emit_value(one.before))} to {new}"
