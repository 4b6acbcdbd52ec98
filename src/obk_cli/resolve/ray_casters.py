"""The files of `config_path`: read and put in place as `scan_config`, for the checks.

A stack whose files have been looked for in; the same stack with ray casters out, every value with
its place in its own file. What the plan carries stays as written.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from obk_cli.config import Sim, Stack
from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.resolve.include import Loaded
from obk_cli.source import Span
from obk_cli.tree import Entry, Tree, TreeList, TreeMap, TreeScalar, kind_of

__all__ = ["resolve_ray_casters"]

_WRAPPER = "scan_config"
_PATH = "config_path"


def resolve_ray_casters(
    stack: Stack, load: Callable[[Path], Loaded]
) -> tuple[Stack, tuple[Diagnostic, ...]]:
    """The stack with `Sim.checked` filled in, and findings about the files."""
    if not any(sim.files for node in stack.nodes for sim in node.sims):
        return stack, ()
    reader = _Reader(load)
    nodes = tuple(
        replace(node, sims=tuple(reader.in_sim(sim) for sim in node.sims)) if node.sims else node
        for node in stack.nodes
    )
    return replace(stack, nodes=nodes), tuple(dict.fromkeys(reader.faults))


class _Reader:
    def __init__(self, load: Callable[[Path], Loaded]) -> None:
        self.faults: list[Diagnostic] = []
        self._load = load

    def in_sim(self, sim: Sim) -> Sim:
        """The block with the files of its sensor groups put in place."""
        paths = {file.written.span: file.found for file in sim.files}
        entry = sim.tree.get("sensor_settings")
        if not paths or entry is None or not isinstance(entry.value, TreeList):
            return sim
        groups = tuple(self._in_group(group, paths) for group in entry.value.items)
        filled = replace(entry, value=replace(entry.value, items=groups))
        entries = tuple(filled if e is entry else e for e in sim.tree)
        return replace(sim, checked=replace(sim.tree, entries=entries))

    def _in_group(self, group: Tree, paths: Mapping[Span, Path | None]) -> Tree:
        entry = group.get(_PATH) if isinstance(group, TreeMap) else None
        if entry is None or not isinstance(group, TreeMap) or group.get(_WRAPPER):
            return group
        path = paths.get(entry.value.span)
        scan = self._read(path, entry) if path is not None else None
        if scan is None:
            return group
        return replace(group, entries=(*group.entries, Entry(_WRAPPER, entry.key_span, scan)))

    def _read(self, path: Path, entry: Entry) -> TreeMap | None:
        loaded = self._load(path)
        self.faults += loaded.diagnostics
        if loaded.unreadable is not None:
            message = f"the file of `{_PATH}` cannot be read: {loaded.unreadable}"
            self.faults.append(found("OBK404", message, entry.value.span, severity="error"))
            return None
        tree = loaded.tree
        wrapped = tree.get(_WRAPPER) if isinstance(tree, TreeMap) else None
        tree = wrapped.value if wrapped else tree
        if isinstance(tree, TreeMap):
            return tree
        if not loaded.diagnostics:
            self.faults.append(_no_ray_caster(tree, entry))
        return None


def _no_ray_caster(tree: Tree | None, entry: Entry) -> Diagnostic:
    if tree is None or (isinstance(tree, TreeScalar) and tree.value is None):
        message = f"the file of `{_PATH}` is empty, expected a ray caster"
        return found("OBK103", message, entry.value.span)
    return found(
        "OBK103",
        f"the file holds {kind_of(tree)}, expected a ray caster: a mapping with `site_name` and "
        "`pattern`",
        tree.span,
        related=(Related(message=f"the `{_PATH}`", span=entry.value.span),),
    )
