"""`--set path=value` on a merged config. Options as text in; the tree with them set out."""

import re
from collections.abc import Callable, Iterable

from obelisk_spec.suggestions import did_you_mean
from obk_cli.diagnostics import Diagnostic, found
from obk_cli.source import COMMAND_LINE, SourceFile, Span
from obk_cli.tree import Entry, Tree, TreeList, TreeMap, kind_of

__all__ = ["ParseValue", "resolve_overrides"]

ParseValue = Callable[[SourceFile], tuple[Tree | None, tuple[Diagnostic, ...]]]

_STEP = re.compile(r"(?:^|\.)([A-Za-z_][\w-]*)|\[([0-9]{1,9})\]")
_MOST_STEPS = 100


class _UnfitError(Exception):
    """A path that leads nowhere; its help says what is there."""

    def __init__(self, message: str, help: str | None = None) -> None:
        super().__init__(message)
        self.help = help


def resolve_overrides(
    tree: TreeMap, options: Iterable[str], parse: ParseValue
) -> tuple[TreeMap, tuple[Diagnostic, ...]]:
    """The tree with each option set in turn; the place of a value set is `<command line>`."""
    faults: list[Diagnostic] = []
    for option in options:
        span = Span.at(SourceFile.of(COMMAND_LINE, option), 1, 1, max(len(option), 1))
        try:
            path, text = _split(option)
            value, value_faults = parse(SourceFile.of(COMMAND_LINE, text))
            faults += value_faults
            if value is not None and not value_faults:
                new = _set(tree, path, value, span)
                tree = new if isinstance(new, TreeMap) else tree
        except _UnfitError as error:
            faults.append(found("OBK012", f"`--set {option}`: {error}", span, help=error.help))
    return tree, tuple(faults)


def _split(option: str) -> tuple[list[str | int], str]:
    path, equals, text = option.partition("=")
    if not equals:
        raise _UnfitError("there is no `=`", "write it as `path=value`")
    steps: list[str | int] = []
    at = 0
    while at < len(path):
        step = _STEP.match(path, at)
        if step is None or (at == 0 and path.startswith((".", "["))):
            raise _UnfitError(f"`{path}` is not a path", "write it as `robot[0].sim[0].time_step`")
        steps.append(step[1] if step[1] is not None else int(step[2]))
        at = step.end()
    if not steps:
        raise _UnfitError("the path is empty", "write it as `robot[0].sim[0].time_step`")
    if len(steps) > _MOST_STEPS:
        raise _UnfitError(f"the path has {len(steps)} steps, expected at most {_MOST_STEPS}")
    return steps, text or "~"


def _set(tree: Tree | None, path: list[str | int], value: Tree, span: Span) -> Tree:
    if not path:
        return value
    step, rest = path[0], path[1:]
    if isinstance(step, str):
        return _set_key(tree, step, rest, value, span)
    if isinstance(tree, TreeMap) and step == 0:
        return _set(tree, rest, value, span)
    if not isinstance(tree, TreeList):
        what = "nothing" if tree is None else kind_of(tree)
        raise _UnfitError(f"`[{step}]` needs a list, there is {what}")
    if step >= len(tree.items):
        count = len(tree.items)
        raise _UnfitError(f"`[{step}]` is past the end, the list has {count} (from [0])")
    items = list(tree.items)
    items[step] = _set(items[step], rest, value, span)
    return TreeList(tuple(items), tree.span)


def _set_key(
    tree: Tree | None, key: str, rest: list[str | int], value: Tree, span: Span
) -> TreeMap:
    if tree is None:
        tree = TreeMap((), span)
    if not isinstance(tree, TreeMap):
        raise _UnfitError(f"`{key}` needs a mapping, there is {kind_of(tree)}")
    old = tree.get(key)
    if old is None and rest and isinstance(rest[0], int):
        known = [entry.key for entry in tree]
        raise _UnfitError(f"there is no `{key}`", did_you_mean(key, known))
    new = Entry(key, span, _set(old.value if old else None, rest, value, span))
    if old is None:
        return TreeMap((*tree.entries, new), tree.span)
    return TreeMap(tuple(new if entry.key == key else entry for entry in tree), tree.span)
