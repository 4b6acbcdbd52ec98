"""`obk param save CONFIG`: write the parameters of running nodes into their config."""

import sys
from collections.abc import Mapping

from obelisk_spec.values import ParameterValue
from obk_cli.cli.config_options import (
    make_options,
    print_findings,
    wants_colour,
)
from obk_cli.cli.edited_files import EditedFile, open_for_edit, report_diff, write_edited
from obk_cli.compiler import compile_config
from obk_cli.configedit.save_params import SavedParameter, save_parameters
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.emit.params import emit_value
from obk_cli.errors import CommandFailedError
from obk_cli.introspect.graph_source import open_graph, parameters_of
from obk_cli.introspect.resolve import settle
from obk_cli.introspect.target import GraphTarget
from obk_cli.introspect.tuning import tunable
from obk_cli.ros.parameters import NodeParameter
from obk_cli.terminal import plain

__all__ = ["save"]


def save(config: str, target: GraphTarget, timeout_s: float, *, is_dry: bool) -> None:
    """Write the values, or with `is_dry` show the difference.

    Raises:
        CommandFailedError: the config has errors, none of its nodes is running, or a value cannot
            be written.
    """
    options = make_options(None, None)
    declared = compile_config(config, options).config
    wanted = {
        node.full_name: frozenset(parameter.name for parameter in node.params)
        for node in (declared.nodes if declared else ())
    }
    values = _present_values(wanted, target, timeout_s) if wanted else {}
    saved = save_parameters(config, options, values)
    if saved.findings:
        print_findings(saved.findings)
        raise CommandFailedError(f"`{config}` has errors; nothing was written")
    files = [(_opened(source.path), text) for source, text in saved.files]
    for file, text in files:
        if is_dry:
            print(report_diff(file.source, text, colour=wants_colour("auto")), end="")
        else:
            write_edited(file, text)
    written = [one for one in saved.parameters if not one.fault]
    for one in () if is_dry else written:
        print(f"{one.place.path}:{one.place.line}: {_change(one)}")
    if not saved.parameters:
        print(f"{config}: nothing to write, the nodes already use its values", file=sys.stderr)
    faults = [one for one in saved.parameters if one.fault]
    if faults:
        lines = (f"{one.place}: {_change(one)}: {one.fault}" for one in faults)
        raise CommandFailedError("not written: " + "\n".join(lines), help="edit these by hand")


def _present_values(
    wanted: Mapping[str, frozenset[str]], target: GraphTarget, timeout_s: float
) -> dict[str, dict[str, ParameterValue]]:
    """Current values of the config's own and tuned parameters in its running nodes."""
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
            "no node of the config is running", help="start the stack with `obk launch`"
        )
    for node in sorted(wanted.keys() - found.keys()):
        print(f"warning: {node} is not running; its values are unchanged", file=sys.stderr)
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
