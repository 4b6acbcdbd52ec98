"""Write parameter values into a config; comments and layout are kept, no other value changes.

The result is the new text of the config's files; nothing is written here. Each edit is verified by
compiling the result: the plan may differ only in these parameters.
"""

from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from obelisk_spec.values import ParameterValue
from obk_cli.compiler import Options, Outcome, compile_config
from obk_cli.config.fixes import is_flow
from obk_cli.config.model import ConfigParameter, Node
from obk_cli.config.tree import Tree, TreeList, TreeMap
from obk_cli.config.yaml_parser import parse_source
from obk_cli.configedit.autofix import plan_without_places
from obk_cli.configedit.block_editor import inline_text
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.edits import Edit, Offsets, apply_edits
from obk_cli.diagnostics.source import SourceFile, Span, indent_of, line_end_of
from obk_cli.plan.plan import Plan

__all__ = ["SavedParameter", "SavedParameters", "save_parameters"]

Values = Mapping[str, Mapping[str, ParameterValue]]
"""Full name of a node -> parameter -> value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SavedParameter:
    """A value that is, or cannot be, written to the config."""

    node: str
    """Full name."""
    name: str
    before: ParameterValue | None
    """None: the config does not set it."""
    after: ParameterValue
    place: Span
    fault: str = ""
    """Why it cannot be written; empty if it can."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SavedParameters:
    """The result of saving parameters."""

    findings: tuple[Diagnostic, ...] = ()
    """Errors of the current config; nothing is written then."""
    parameters: tuple[SavedParameter, ...] = ()
    files: tuple[tuple[SourceFile, str], ...] = ()
    """Every changed file: the old source and the new text."""


def save_parameters(path: str, options: Options, values: Values) -> SavedParameters:
    """Write the values that differ from those of the config at this path."""
    outcome = compile_config(path, options)
    plan = plan_without_places(outcome)
    if outcome.config is None or plan is None:
        errors = tuple(f for f in outcome.diagnostics if f.severity == "error")
        return SavedParameters(findings=errors)
    tried: dict[tuple[str, str], SavedParameter] = {}
    originals: dict[Path, SourceFile] = {}
    texts: dict[Path, str] = {}
    # One by one, because each edit is located in the text with the previous ones applied.
    while (change := _next_change(outcome, values, tried)) is not None:
        one, edit = change
        key = (one.node, one.name)
        tried[key] = one
        if edit is None:
            continue
        file = (options.working_folder / edit.span.path).resolve()
        attempt = {**texts, file: apply_edits(edit.span.source, [edit])}
        following = compile_config(path, replace(options, read=_reader(options, attempt)))
        expected = _with_value(plan, one)
        if following.config is None or plan_without_places(following) != expected:
            tried[key] = replace(one, fault="the edit would change more than this value")
            continue
        originals.setdefault(file, edit.span.source)
        outcome, plan, texts = following, expected, attempt
    return SavedParameters(
        parameters=tuple(tried.values()),
        files=tuple((originals[file], text) for file, text in texts.items()),
    )


def _next_change(
    outcome: Outcome, values: Values, tried: Container[tuple[str, str]]
) -> tuple[SavedParameter, Edit | None] | None:
    assert outcome.config is not None
    changes = (
        change
        for node in outcome.config.nodes
        for change in _changes(node, values.get(node.full_name, {}))
    )
    return next((c for c in changes if (c[0].node, c[0].name) not in tried), None)


def _changes(
    node: Node, values: Mapping[str, ParameterValue]
) -> Iterator[tuple[SavedParameter, Edit | None]]:
    written = {parameter.name: parameter for parameter in node.params}
    for name, value in values.items():
        known = written.get(name)
        if known is None:
            one = SavedParameter(
                node=node.full_name, name=name, before=None, after=value, place=node.span
            )
            added = _added(node, name, value)
            fault = "" if added else "write `params:` of the node as a block, one key on each line"
            yield replace(one, fault=fault), added
        elif known.value != value:
            one = SavedParameter(
                node=node.full_name, name=name, before=known.value, after=value, place=known.span
            )
            fault = _reason_to_reject(known)
            edit = None if fault else Edit(known.span, inline_text(_plain(value)))
            yield replace(one, fault=fault), edit


def _reason_to_reject(parameter: ConfigParameter) -> str:
    span, key = parameter.span, parameter.key_span
    if span.path.startswith("<"):
        return f"it is set by {span.path}"
    if "${" in span.text or (key is not None and span.line < key.line):
        return "it uses a variable or an alias"
    if span.end_line != span.line:
        return "it spans several lines"
    return ""


def _added(node: Node, name: str, value: ParameterValue) -> Edit | None:
    """Insert a new line below the node's last parameter, or `params:` below its executable."""
    source = node.span.source
    tree = _map_at(parse_source(source).tree, node.span)
    if tree is None or is_flow(tree) or not tree.entries:
        return None
    line = f"{name}: {inline_text(_plain(value))}"
    params = tree.get("params")
    if params is None:
        above = tree.get("executable") or tree.entries[0]
        column = above.key_span.column - 1
        return _below(
            source, above.value.span, [f"{' ' * column}params:", f"{' ' * column}  {line}"]
        )
    block = params.value
    if not isinstance(block, TreeMap) or is_flow(block) or block.span.line < params.key_span.line:
        return None
    column = block.entries[0].key_span.column - 1
    return _below(source, block.entries[-1].value.span, [f"{' ' * column}{line}"])


def _below(source: SourceFile, span: Span, lines: list[str]) -> Edit | None:
    offsets, end = Offsets.of(source), line_end_of(source.text)
    if indent_of(source.line(span.end_line)) == len(source.line(span.end_line)):
        return None
    at = offsets.at(span.end_line, len(source.line(span.end_line)) + 1)
    return offsets.insert(at, "".join(f"{end}{line}" for line in lines))


def _map_at(tree: Tree | None, span: Span) -> TreeMap | None:
    match tree:
        case TreeMap():
            if (tree.span.line, tree.span.column) == (span.line, span.column):
                return tree
            children = [entry.value for entry in tree]
        case TreeList():
            children = list(tree.items)
        case _:
            return None
    return next((found for child in children if (found := _map_at(child, span))), None)


def _plain(value: ParameterValue) -> object:
    return list(value) if isinstance(value, tuple) else value


def _reader(options: Options, texts: Mapping[Path, str]) -> Callable[[str], bytes | str]:
    def read(path: str) -> bytes | str:
        text = texts.get((options.working_folder / path).resolve())
        return options.read(path) if text is None else text.encode("utf-8")

    return read


def _with_value(plan: Plan, saved: SavedParameter) -> Plan:
    return replace(
        plan,
        nodes=tuple(
            replace(node, parameters={**node.parameters, saved.name: saved.after})
            if node.full_name == saved.node
            else node
            for node in plan.nodes
        ),
    )
