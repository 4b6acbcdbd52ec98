"""The `sim` blocks of a robot."""

from dataclasses import replace

from obelisk_spec.values import LONGEST_PERIOD_S
from obk_cli.config import SensorGroup, Sim, Spanned
from obk_cli.cures import respell
from obk_cli.diagnostics import found
from obk_cli.read.fields import Faults, Fields, read_items, read_text
from obk_cli.read.keys import OLDER_KEYS, SENSOR_GROUP_KEYS, SIM_KEYS
from obk_cli.read.names import check_package, check_topic
from obk_cli.tree import TreeList, TreeMap, TreeScalar

__all__ = ["read_sim"]


def read_sim(tree: TreeMap, faults: Faults) -> Sim:
    """One block; `is_sound` is False where any of it is wrong."""
    own: Faults = []
    groups, tree = _with_newer_names(tree, own)
    fields = Fields(tree, "`sim`", SIM_KEYS, own)
    fields.count("num_steps_per_viz")
    fields.count("n_u", least=0)
    fields.period_s("time_step")
    _read_viz_geoms(fields, own)
    sim = Sim(
        tree=tree,
        ros_parameter=fields.text("ros_parameter"),
        model_xml_path=fields.text("model_xml_path", required=True),
        robot_pkg=check_package(fields.no_or_text("robot_pkg"), own),
        sensor_groups=tuple(_read_group(group, own) for group in groups),
        config_paths=_config_paths(groups),
    )
    faults += own
    return replace(sim, is_sound=not any(fault.severity == "error" for fault in own))


def _with_newer_names(tree: TreeMap, faults: Faults) -> tuple[tuple[TreeMap, ...], TreeMap]:
    """The sensor groups with older keys renamed, and the block with those groups in it."""
    entry = tree.get("sensor_settings")
    if entry is None or (isinstance(entry.value, TreeScalar) and entry.value.value is None):
        return (), tree
    items = read_items("sensor_settings", entry.value, faults)
    groups = tuple(_renamed(group, faults) for group in items)
    new = replace(entry, value=TreeList(groups, entry.value.span))
    return groups, replace(tree, entries=tuple(new if e is entry else e for e in tree))


def _renamed(group: TreeMap, faults: Faults) -> TreeMap:
    entries = []
    for entry in group:
        newer = OLDER_KEYS.get(entry.key)
        if newer is not None and group.get(newer) is None:
            message = f"`{entry.key}` is the older name of `{newer}`"
            cure = respell(entry.key_span, entry.key, newer)
            help = f"write `{newer}`"
            faults.append(found("OBK501", message, entry.key_span, help=help, fix=cure))
            entry = replace(entry, key=newer)
        entries.append(entry)
    return replace(group, entries=tuple(entries))


def _read_group(tree: TreeMap, faults: Faults) -> SensorGroup:
    fields = Fields(tree, "a sensor group", SENSOR_GROUP_KEYS, faults)
    fields.count("history_depth")
    fields.mapping("scan_config")
    fields.mapping("noise")
    fields.number("dropout", least=0, most=1)
    fields.number("delay", least=0, most=LONGEST_PERIOD_S)
    fields.count("seed", least=0)
    names = fields.mapping("sensor_names")
    for entry in names or ():
        read_text(f"the type of sensor `{entry.key}`", entry.value, faults)
    return SensorGroup(
        topic=check_topic(fields.text("topic", required=True), faults) or Spanned("", fields.start),
        msg_type=fields.text("msg_type", required=True),
        period_s=fields.period_s("dt", required=True),
        span=fields.start,
    )


def _config_paths(groups: tuple[TreeMap, ...]) -> tuple[Spanned[str], ...]:
    paths = (Fields(g, "a sensor group", SENSOR_GROUP_KEYS, []).text("config_path") for g in groups)
    return tuple(path for path in paths if path is not None)


def _read_viz_geoms(fields: Fields, faults: Faults) -> None:
    tree = fields.mapping("viz_geoms")
    if tree is None:
        return
    geoms = Fields(tree, "`viz_geoms`", tuple(entry.key for entry in tree), faults)
    geoms.period_s("dt")
    for entry in tree:
        if entry.key != "dt":
            read_text(f"the type of geom `{entry.key}`", entry.value, faults)
