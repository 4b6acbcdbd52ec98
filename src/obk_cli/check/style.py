"""OBK502, OBK507: config text that works here but not elsewhere, or that is redundant."""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping

from obelisk_spec.components import DEFAULT_HISTORY_DEPTH
from obelisk_spec.sim_block import DEFAULT_STEPS_PER_VIZ
from obelisk_spec.values import is_none
from obk_cli.check.context import CheckContext
from obk_cli.config.fixes import remove_entry
from obk_cli.config.model import FileSearch, Node, Sim
from obk_cli.config.tree import Entry, TreeList, TreeMap, TreeScalar
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.edits import Edit
from obk_cli.diagnostics.source import Span

__all__ = ["check_defaults", "check_homes"]

_HOME = re.compile(r"""["']?(/home/[^/\s]+|/Users/[^/\s]+|/root)/""")
_TIMER_DEFAULTS = {"callback_group": "None"}
_TOPIC_DEFAULTS = {"history_depth": DEFAULT_HISTORY_DEPTH, **_TIMER_DEFAULTS}
_QOS_DEFAULTS = {
    "reliability": "reliable",
    "durability": "volatile",
    "history_depth": DEFAULT_HISTORY_DEPTH,
}
_SIM_DEFAULTS = {"num_steps_per_viz": DEFAULT_STEPS_PER_VIZ, "robot_pkg": "None"}
_GROUP_DEFAULTS = {"history_depth": DEFAULT_HISTORY_DEPTH}
_MOST_SHOWN = 2


def check_homes(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that no path leads into a user's home; a path with `${HOME}` is fine."""
    for node in context.stack.nodes:
        missing = {file.written.span for file in _missing_files(node)}
        for span in _path_spans(node):
            home = _HOME.match(span.text)
            if home is not None and span not in missing:
                yield found(
                    "OBK502",
                    f"`{span.text.strip(chr(34) + chr(39))}` is a path into a user's home "
                    "directory, and does not exist for other users or on other machines",
                    span,
                    help="make it relative to the config, set `robot_pkg`, or begin the path with "
                    "`${HOME}`",
                )


def _missing_files(node: Node) -> Iterator[FileSearch]:
    """Files that already have findings."""
    files = [node.params_file, node.urdf_file]
    for sim in node.used_sims:
        files += [sim.model, *sim.files]
    yield from (file for file in files if file is not None and file.found is None)


def _path_spans(node: Node) -> Iterator[Span]:
    written = [node.params_path, node.urdf]
    for sim in node.used_sims:
        written += [sim.model_xml_path, *sim.config_paths]
    yield from (path.span for path in written if path is not None)
    yield from (parameter.span for parameter in node.params if isinstance(parameter.value, str))


def check_defaults(context: CheckContext) -> Iterator[Diagnostic]:
    """Report keys set to their default, once per key."""
    places: dict[str, list[Span]] = defaultdict(list)
    edits: dict[str, list[Edit]] = defaultdict(list)
    for node in context.stack.nodes:
        for tree, entry in _written_defaults(node):
            written = f"{entry.key}: {entry.value.span.text}"
            places[written].append(entry.key_span)
            edits[written] += remove_entry(tree, entry)
    for written, (first, *others) in places.items():
        count = f" {len(others) + 1} times" if others else ""
        yield found(
            "OBK507",
            f"`{written}` is the default; it is set explicitly{count}",
            first,
            help="it can be removed",
            related=(Related(message="also here", span=span) for span in others[:_MOST_SHOWN]),
            fix=edits[written],
        )


def _written_defaults(node: Node) -> Iterator[tuple[TreeMap, Entry]]:
    for component in node.components:
        is_timer = component.kind == "timer"
        yield from _equal(component.tree, _TIMER_DEFAULTS if is_timer else _TOPIC_DEFAULTS)
        qos = component.tree.get("qos")
        if qos is not None and isinstance(qos.value, TreeMap):
            yield from _equal(qos.value, _QOS_DEFAULTS)
    for sim in node.used_sims:
        yield from _equal(sim.tree, _SIM_DEFAULTS)
        for group in _groups(sim):
            yield from _equal(group, _GROUP_DEFAULTS)


def _groups(sim: Sim) -> Iterator[TreeMap]:
    entry = sim.tree.get("sensor_settings")
    if entry is not None and isinstance(entry.value, TreeList):
        yield from (group for group in entry.value.items if isinstance(group, TreeMap))


def _equal(tree: TreeMap, defaults: Mapping[str, object]) -> Iterator[tuple[TreeMap, Entry]]:
    for entry in tree:
        value = entry.value
        if not isinstance(value, TreeScalar) or value.value is None:
            continue
        if value.read_from is not None:  # a variable, which may have another value tomorrow
            continue
        default, written = defaults.get(entry.key), value.value
        # `true` equals a whole number, but has its own finding.
        is_same = type(written) is type(default) and written == default
        if is_same or (default == "None" and is_none(written)):
            yield tree, entry
