"""OBK3xx: `sim` blocks against their models."""

from collections.abc import Iterator

from obelisk_spec.near import list_names
from obelisk_spec.sim_checks import SimFault, check_sim
from obk_cli.check.context import CheckContext
from obk_cli.check.files import no_such_package, where_it_is_not
from obk_cli.config import FileSearch, Node, Sim
from obk_cli.cures import respell
from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.source import Span
from obk_cli.surroundings import ModelFault, ModelRead, Surroundings
from obk_cli.tree import Tree, TreeList, TreeMap, TreeScalar, plain_value

__all__ = ["check_models"]


def check_models(context: CheckContext) -> Iterator[Diagnostic]:
    """Every sound `sim` block, against its model where that can be read."""
    skipped: Span | None = None
    for node in context.stack.nodes:
        for sim in node.sims:
            if not sim.is_sound or sim.model is None:
                continue
            read = None
            if sim.model.found is None:
                yield _not_found(sim.model, sim, context.surroundings)
            else:
                read = context.surroundings.read_model(sim.model.found)
                skipped = skipped or (sim.model.written.span if read is None else None)
            if isinstance(read, ModelFault):
                yield _unreadable(read, sim.model, context.surroundings)
            in_block = tuple(_check_block(node, sim, read, context.surroundings))
            # What MuJoCo stops at may be what the block was told of already.
            is_told = any(finding.severity == "error" for finding in in_block)
            if isinstance(read, ModelRead) and read.fault is not None and not is_told:
                yield _unreadable(read.fault, sim.model, context.surroundings)
            yield from in_block
    if skipped is not None:
        message = "MuJoCo is not installed, so names are not checked against the model"
        help = "install the `mujoco` package to have them checked"
        yield found("OBK300", message, skipped, help=help)


def _not_found(model: FileSearch, sim: Sim, surroundings: Surroundings) -> Diagnostic:
    if model.missing_package is not None and sim.robot_pkg is not None:
        return no_such_package(model, sim.robot_pkg, "model", surroundings)
    hint = "" if sim.robot_pkg or model.near else "; name the package that holds it as `robot_pkg`"
    message = f"model `{model.written.value}` is not found"
    return found("OBK301", message, model.written.span, help=where_it_is_not(model) + hint)


def _unreadable(fault: ModelFault, model: FileSearch, surroundings: Surroundings) -> Diagnostic:
    related: tuple[Related, ...] = ()
    if fault.line and model.found is not None:
        place = surroundings.model_line(model.found, fault.line)
        related = (Related(message="MuJoCo stopped here", span=place),)
    message = f"MuJoCo cannot read `{model.written.value}`: {fault.message}"
    return found("OBK302", message, model.written.span, related=related)


def _check_block(
    node: Node, sim: Sim, read: ModelRead | ModelFault | None, surroundings: Surroundings
) -> Iterator[Diagnostic]:
    parameters = {parameter.name: parameter.value for parameter in node.params}
    facts = read.facts if isinstance(read, ModelRead) else None
    block = plain_value(sim.checked or sim.tree)
    assert isinstance(block, dict)  # a TreeMap's value is one
    for fault in check_sim(block, parameters, facts):
        yield _placed(fault, node, sim, surroundings)
    if isinstance(read, ModelRead) and read.missing_files and sim.model is not None:
        count = len(read.missing_files)
        yield found(
            "OBK318",
            f"{count} file{'s' if count > 1 else ''} of the model `{sim.model.written.value}` "
            f"{'are' if count > 1 else 'is'} missing: {list_names(read.missing_files, most=3)}",
            sim.model.written.span,
            help="the simulation cannot start without them; the model's structure was checked",
        )


def _placed(fault: SimFault, node: Node, sim: Sim, surroundings: Surroundings) -> Diagnostic:
    """A finding of the shared checks at its place in the config and in the model."""
    related: tuple[Related, ...] = ()
    if fault.element is not None and sim.model is not None and sim.model.found is not None:
        kind, name = fault.element
        place = surroundings.model_element(sim.model.found, kind, name)
        if place is not None:
            related = (Related(message="in the model", span=place),)
    span, written = _place_of(fault, node, sim)
    return found(
        fault.code,
        fault.message,
        span,
        help=fault.help,
        severity=fault.severity,
        related=related,
        fix=respell(span, written, fault.meant) if fault.meant and written else (),
    )


def _place_of(fault: SimFault, node: Node, sim: Sim) -> tuple[Span, str | None]:
    """Where a finding is, and the word there if another may stand in its place."""
    if fault.path[:1] == ("params",):
        name = ".".join(str(step) for step in fault.path[1:])
        parameter = next((p for p in node.params if p.name == name), None)
        return (parameter.span, str(parameter.value)) if parameter else (node.span, None)
    tree: Tree = sim.checked or sim.tree
    span, written = tree.span, None
    for step in fault.path:
        if isinstance(tree, TreeMap) and isinstance(step, str):
            entry = tree.get(step)
            if entry is None:
                return span, None
            is_key = fault.points_at == "key"
            is_taken = is_key and fault.meant is not None and tree.get(fault.meant) is not None
            tree = entry.value
            span = entry.key_span if is_key else tree.span
            written = None if is_taken else entry.key if is_key else _text(tree)
        elif isinstance(tree, TreeList) and isinstance(step, int):
            tree = tree.items[step]
            span, written = tree.span, _text(tree)
    return span, written


def _text(tree: Tree) -> str | None:
    return tree.value if isinstance(tree, TreeScalar) and isinstance(tree.value, str) else None
