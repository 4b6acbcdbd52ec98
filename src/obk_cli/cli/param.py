"""`obk param list|get|set|save|dump`: the parameters of running nodes."""

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import click
import typer
from typer.core import TyperCommand

from obelisk_spec.suggestions import did_you_mean
from obk_cli.cli.complete import complete_nodes
from obk_cli.cli.options import (
    TIMEOUT_S,
    DomainOption,
    FormatOption,
    NodeArgument,
    TimeoutOption,
    graph_target,
    print_json,
    wants_json,
)
from obk_cli.emit.params import emit_node_params
from obk_cli.errors import CommandFailedError
from obk_cli.ros.parameters import (
    UNDESCRIBED,
    NodeParameter,
    ParameterDescription,
    parse_parameter,
)
from obk_cli.terminal import plain

if TYPE_CHECKING:
    from obk_cli.introspect.graph_source import Parameters

__all__ = ["app"]

NEGATIVE: Final = re.compile(r"-(\d|\.\d|\.?inf\b)", re.IGNORECASE)

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Show and set parameters of running nodes.",
)


@app.callback(epilog="Example: obk param get robot_0 use_sim_time")
def _root() -> None:
    """Show and set parameters of running nodes, by name (control_0) or by section (control)."""


_AT_CONFIGURE = " (takes effect at the next `configure` transition)"


@app.command("list", epilog="Example: obk param list control_0")
def list_(
    node: Annotated[
        str | None,
        typer.Argument(
            help="Node name, full or short, or a section. Default: all nodes.",
            autocompletion=complete_nodes,
        ),
    ] = None,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
    format: FormatOption = "text",
) -> None:
    """Show parameters of one or all nodes: type, range, unit."""
    is_json = wants_json(format)
    target = graph_target(domain, timeout)

    from obk_cli.introspect.graph_source import open_graph, parameters_of
    from obk_cli.introspect.resolve import find_node, settle
    from obk_cli.ros.graph import parameter_nodes

    found: dict[str, Mapping[str, ParameterDescription]] = {}
    silent: list[str] = []
    with open_graph(target, node, asks_nodes=True) as source:
        if node is None:
            settle(source, target, timeout)
            nodes = parameter_nodes(source.graph())
        else:
            nodes = (find_node(source, target, node, timeout),)
        for one in nodes:
            try:
                parameters = parameters_of(source, one, timeout)
                names = parameters.names()
                described = parameters.describe(names)
                found[one] = {name: described.get(name, UNDESCRIBED) for name in names}
            except CommandFailedError as error:
                silent.append(error.message)
    if is_json:
        print_json({one: _described(of_node) for one, of_node in found.items()})
    elif node is not None:
        print("\n".join(line for of_node in found.values() for line in _description_lines(of_node)))
    else:
        for one, of_node in found.items():
            print("\n".join([f"{one}:", *(f"  {line}" for line in _description_lines(of_node))]))
    if silent:
        raise CommandFailedError("; ".join(silent))


@app.command(epilog="Example: obk param get robot_0 ic_keyframe")
def get(
    node: NodeArgument,
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME...]", help="Parameter names. Default: all.")
    ] = None,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
    format: FormatOption = "text",
) -> None:
    """Show the values of a node's parameters, with their types.

    Exit code 1 if the node has no parameter of that name.
    """
    is_json = wants_json(format)
    with _open_parameters(node, domain, timeout) as opened:
        known = opened.parameters.names()
        requested = tuple(names or known)
        _require_known(opened.node, requested, known)
        values = opened.parameters.values(requested)
    if is_json:
        print_json({name: {"type": one.kind, "value": one.value} for name, one in values.items()})
        return
    print("\n".join(_lines(values)))


class _TakesNegativeNumbers(TyperCommand):
    """A command whose last argument may be a negative number."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put `--` before a negative number, so that click does not take it for an option."""
        place = next((n for n, word in enumerate(args) if NEGATIVE.match(word)), None)
        if "--" not in args and place is not None and not args[place - 1].startswith("-"):
            args = [*args[:place], *args[place + 1 :], "--", args[place]]
        return super().parse_args(ctx, args)


@app.command("set", cls=_TakesNegativeNumbers, epilog="Example: obk param set control_0 gain 2.5")
def set_(
    node: NodeArgument,
    name: Annotated[str, typer.Argument(help="Parameter name.")],
    value: Annotated[str, typer.Argument(help="As YAML: 2.5, -1, true, on, [1, 2], 'some text'.")],
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
) -> None:
    """Set a parameter, and report when the value takes effect.

    VALUE is parsed as in a ROS parameter file, then converted to the parameter's type: for a
    double, 1 means 1.0. Exit code 1 if the node rejects the value or fails because of it; its
    reason is shown.
    """
    parse_parameter(value)
    with _open_parameters(node, domain, timeout) as opened:
        from obk_cli.introspect.tuning import set_parameter

        print(f"{opened.node}: {set_parameter(opened.parameters, opened.node, name, value)}")


@app.command(epilog="Example: obk param dump control_0 --output control_0.yaml")
def dump(
    node: NodeArgument,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="Output file. Default: print to the terminal."
        ),
    ] = None,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
) -> None:
    """Write a node's parameters to a file for `--params-file`."""
    with _open_parameters(node, domain, timeout) as opened:
        values = opened.parameters.values(opened.parameters.names())
    written = {}
    for name, one in values.items():
        if one.value is None or one.kind == "byte_array":
            print(f"warning: {name} is {one.kind} and was skipped", file=sys.stderr)
        else:
            written[name] = one.value
    text = emit_node_params(opened.node, written)
    if output is None or output == Path("-"):
        print(text, end="")
        return

    from obk_cli.files import unwritable, write_text

    try:
        write_text(output, text)
    except OSError as error:
        raise unwritable(output, error) from error
    print(f"wrote {len(written)} parameters of {opened.node} to {output}", file=sys.stderr)


@app.command(epilog="Example: obk param save stack.yaml --diff")
def save(
    config: Annotated[str, typer.Argument(metavar="CONFIG", help="Config to edit.")],
    diff: Annotated[
        bool, typer.Option("--diff", help="Show the changes without writing them.")
    ] = False,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
) -> None:
    """Write the current parameters of running nodes into their config.

    The command updates values under `params` that differ from those of the nodes, and adds tuned
    parameters that the config lacks. Comments and layout are kept. Each edit is verified by
    compiling the config again. Exit code 1 if a value cannot be written.
    """
    target = graph_target(domain, timeout)

    from obk_cli.cli.config_options import make_options, print_findings, wants_colour
    from obk_cli.introspect.config_update import find_update, write_update

    update = find_update(config, make_options(None, None), target, timeout)
    for node in update.missing_nodes:
        print(f"warning: {node} is not running; its values are unchanged", file=sys.stderr)
    if update.findings:
        print_findings(update.findings)
        raise CommandFailedError(f"`{config}` has errors; nothing was written")
    if diff:
        print(update.diff(colour=wants_colour("auto")), end="")
    else:
        write_update(update)
        for change in update.changes():
            print(change)
    if not update.parameters:
        print(f"{config}: nothing to write, the nodes already use its values", file=sys.stderr)
    if faults := list(update.faults()):
        raise CommandFailedError("not written: " + "\n".join(faults), help="edit these by hand")


@dataclass(frozen=True, slots=True, kw_only=True)
class _NodeParameters:
    """One node and its parameters."""

    node: str
    parameters: "Parameters"


@contextmanager
def _open_parameters(node: str, domain: int | None, timeout_s: float) -> Iterator[_NodeParameters]:
    target = graph_target(domain, timeout_s)

    from obk_cli.introspect.graph_source import open_graph, parameters_of
    from obk_cli.introspect.resolve import find_node

    with open_graph(target, node, asks_nodes=True) as source:
        found = find_node(source, target, node, timeout_s)
        yield _NodeParameters(node=found, parameters=parameters_of(source, found, timeout_s))


def _require_known(node: str, requested: Sequence[str], known: Sequence[str]) -> None:
    unknown = [name for name in requested if name not in known]
    if unknown:
        raise CommandFailedError(
            f"{node} has no parameter `{unknown[0]}`", help=did_you_mean(unknown[0], known)
        )


def _described(of_node: Mapping[str, ParameterDescription]) -> Mapping[str, object]:
    return {
        name: {
            "type": one.kind,
            "range": [one.notes.least, one.notes.most] if one.notes.range else None,
            "choices": list(one.notes.choices),
            "unit": one.notes.unit,
            "live": one.notes.is_live,
            "description": one.text,
        }
        for name, one in of_node.items()
    }


def _description_lines(of_node: Mapping[str, ParameterDescription]) -> Iterator[str]:
    """A line for each parameter: name, type, range, unit, description."""
    rows = [
        (
            name,
            one.kind,
            one.notes.range or ", ".join(one.notes.choices),
            one.notes.unit,
            one.text + ("" if one.notes.is_live is not False else _AT_CONFIGURE),
        )
        for name, one in of_node.items()
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True) if width)
        yield plain("  ".join(cells).rstrip())


def _lines(values: Mapping[str, NodeParameter]) -> Iterator[str]:
    from obk_cli.introspect.tuning import value_text

    names = max(map(len, values), default=0)
    kinds = max((len(one.kind) for one in values.values()), default=0)
    for name, one in values.items():
        yield f"{name:<{names}}  {one.kind:<{kinds}}  {value_text(one)}"
