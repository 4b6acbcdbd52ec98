"""Read a node of a section or of `viz`: its components, parameters and `sim` blocks."""

from collections.abc import Iterator
from dataclasses import replace
from typing import get_args

from obelisk_spec.components import CALLBACK_GROUP_TYPES, STALE_ACTIONS
from obelisk_spec.values import LONGEST_PERIOD_S, OnCrash, ParameterValue
from obelisk_spec.yaml_core import Scalar
from obk_cli.config.fields import (
    COMPONENT_KEYS,
    NODE_KEYS,
    OLDER_KEYS,
    QOS_KEYS,
    ROBOT_KEYS,
    SENSOR_GROUP_KEYS,
    SIM_KEYS,
    TIMER_KEYS,
    VIZ_NODE_KEYS,
    Faults,
    Fields,
    check_namespace,
    check_node_name,
    check_package,
    check_topic,
    read_items,
    read_text,
)
from obk_cli.config.fixes import remove_entry, respell
from obk_cli.config.model import (
    COMPONENT_LISTS,
    CallbackGroup,
    Component,
    ComponentKind,
    ConfigParameter,
    Node,
    Qos,
    Remapping,
    SensorGroup,
    Sim,
    Spanned,
)
from obk_cli.config.tree import (
    Entry,
    Tree,
    TreeList,
    TreeMap,
    TreeScalar,
    kind_of,
    plain_value,
)
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found

__all__ = ["LOG_LEVELS", "read_node"]

_HOLDS = "a ROS parameter holds a bool, int, float, string or a list of one of these"
_WHOLE_NUMBERS = ("history_depth", "num_steps_per_viz", "n_u", "seed")
_INT64 = range(-(2**63), 2**63)


def read_params(tree: TreeMap | None, faults: Faults) -> tuple[ConfigParameter, ...]:
    """The parameters of a `params` mapping; adds findings for values that ROS cannot hold."""
    by_name: dict[str, ConfigParameter] = {}
    for parameter in _read_map(tree, "", faults) if tree else ():
        first = by_name.setdefault(parameter.name, parameter)
        if first is not parameter:
            faults.append(_given_twice(parameter, first))
    return tuple(by_name.values())


def _given_twice(parameter: ConfigParameter, first: ConfigParameter) -> Diagnostic:
    """Report a duplicate: `a.b: 1` and `a: {b: 1}` are one name."""
    return found(
        "OBK004",
        f"parameter `{parameter.name}` is given twice",
        parameter.key_span or parameter.span,
        related=(Related(message="the first time", span=first.key_span or first.span),),
    )


def _read_map(tree: TreeMap, prefix: str, faults: Faults) -> Iterator[ConfigParameter]:
    for entry in tree:
        name = prefix + entry.key
        if isinstance(entry.value, TreeMap):
            yield from _read_map(entry.value, f"{name}.", faults)
            continue
        value = _read_value(name, entry.value, faults)
        if value is not None:
            yield ConfigParameter(
                name=name, value=value, span=entry.value.span, key_span=entry.key_span
            )


def _read_value(name: str, tree: Tree, faults: Faults) -> ParameterValue | None:
    if isinstance(tree, TreeList):
        return _read_list(name, tree, faults)
    if isinstance(tree, TreeScalar) and tree.value is not None and _fits_ros(tree.value):
        return tree.value
    message = f"parameter `{name}` is {kind_of(tree)}, which is not a valid ROS parameter"
    faults.append(found("OBK113", message, tree.span, help=_HOLDS))
    return None


def _fits_ros(value: Scalar) -> bool:
    """Whether the value fits in ROS's 64 bits, as all but huge integers do."""
    return isinstance(value, bool) or not isinstance(value, int) or value in _INT64


def _read_list(name: str, tree: TreeList, faults: Faults) -> ParameterValue | None:
    if not tree.items:
        message = f"parameter `{name}` is an empty list, so ROS cannot determine its type"
        faults.append(found("OBK113", message, tree.span, help="remove the parameter"))
        return None
    values: list[Scalar] = []
    for item in tree.items:
        if not isinstance(item, TreeScalar) or item.value is None or not _fits_ros(item.value):
            what = (
                "an empty item"
                if isinstance(item, TreeScalar) and item.value is None
                else kind_of(item)
            )
            message = f"parameter `{name}` is a list that contains {what}"
            faults.append(found("OBK113", message, item.span, help=_HOLDS))
            return None
        values.append(item.value)
    return _of_one_kind(name, values, tree, faults)


def _of_one_kind(
    name: str, values: list[Scalar], tree: TreeList, faults: Faults
) -> ParameterValue | None:
    kinds = {type(value) for value in values}
    if kinds == {int, float}:
        message = f"parameter `{name}` mixes int and float and is read as floats"
        faults.append(found("OBK505", message, tree.span))
        return tuple(float(value) for value in values if isinstance(value, int | float))
    if len(kinds) > 1:
        mixed = " and ".join(sorted(kind.__name__ for kind in kinds))
        message = f"parameter `{name}` is a list that mixes {mixed}"
        faults.append(found("OBK113", message, tree.span, help=_HOLDS))
        return None
    one_kind: ParameterValue = tuple(values)  # type: ignore[assignment]  # all of one type
    return one_kind


def read_sim(tree: TreeMap, faults: Faults) -> Sim:
    """Read one block; `is_sound` is False if it has an error."""
    own: Faults = []
    groups, tree = _with_newer_names(_with_whole_numbers(tree), own)
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
    """The sensor groups with older keys renamed, and the block with these groups."""
    entry = tree.get("sensor_settings")
    if entry is None or (isinstance(entry.value, TreeScalar) and entry.value.value is None):
        return (), tree
    items = read_items("sensor_settings", entry.value, faults)
    groups = tuple(_with_whole_numbers(_renamed(group, faults)) for group in items)
    new = replace(entry, value=TreeList(groups, entry.value.span))
    return groups, replace(tree, entries=tuple(new if e is entry else e for e in tree))


def _renamed(group: TreeMap, faults: Faults) -> TreeMap:
    entries = []
    for entry in group:
        newer = OLDER_KEYS.get(entry.key)
        written = group.get(newer) if newer is not None else None
        if written is not None and plain_value(written.value) == plain_value(entry.value):
            message = f"`{entry.key}` has no effect: `{newer}` has the same value"
            edits = remove_entry(group, entry)
            faults.append(found("OBK506", message, entry.key_span, fix=edits))
            continue
        if newer is not None and written is None:
            message = f"`{entry.key}` is the older name for `{newer}`"
            edits = respell(entry.key_span, entry.key, newer)
            help = f"write `{newer}`"
            faults.append(found("OBK501", message, entry.key_span, help=help, fix=edits))
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


def read_components(node: Fields, faults: Faults) -> tuple[Component, ...]:
    """All components of a node, publishers first; of duplicates, the first is used."""
    seen: set[tuple[ComponentKind, str | None]] = set()
    components: list[Component] = []
    for key, kind in COMPONENT_LISTS.items():
        for tree in node.maps(key):
            component = _read_component(_with_whole_numbers(tree), kind, faults)
            same = (kind, component.identity)
            components.append(replace(component, is_unused=same in seen))
            if component.identity is not None:
                seen.add(same)
    return tuple(components)


def _with_whole_numbers(tree: TreeMap) -> TreeMap:
    """The mapping with values such as `history_depth: 10.0` read as 10, also in its `qos`."""

    def whole(entry: Entry) -> Entry:
        value = entry.value
        if entry.key == "qos" and isinstance(value, TreeMap):
            return replace(entry, value=_with_whole_numbers(value))
        if entry.key not in _WHOLE_NUMBERS or not isinstance(value, TreeScalar):
            return entry
        number = value.value
        if not isinstance(number, float) or not number.is_integer():
            return entry
        return replace(entry, value=replace(value, value=int(number)))

    return replace(tree, entries=tuple(map(whole, tree)))


def _read_component(tree: TreeMap, kind: ComponentKind, faults: Faults) -> Component:
    keys = TIMER_KEYS if kind == "timer" else COMPONENT_KEYS
    fields = Fields(tree, f"a {kind}", keys, faults)
    ros_parameter, key = fields.text("ros_parameter"), fields.text("key")
    if fields.entry("ros_parameter") is None and fields.entry("key") is None:
        message = f"this {kind} has neither `ros_parameter` nor `key`"
        faults.append(found("OBK106", message, fields.start))
    group = fields.no_or_text("callback_group")
    if kind == "timer":
        return Component(
            kind=kind,
            span=fields.start,
            tree=tree,
            ros_parameter=ros_parameter,
            key=key,
            callback_group=group,
            timer_period_s=fields.period_s("timer_period_sec", required=True),
        )
    fields.count("history_depth")
    return Component(
        kind=kind,
        span=fields.start,
        tree=tree,
        ros_parameter=ros_parameter,
        key=key,
        callback_group=group,
        topic=check_topic(fields.text("topic", required=True), faults),
        msg_type=fields.text("msg_type"),
        qos=_read_qos(fields.mapping("qos"), faults),
        max_age_s=fields.period_s("max_age_sec"),
        stale_action=fields.one_of("stale_action", STALE_ACTIONS),
    )


def _read_qos(tree: TreeMap | None, faults: Faults) -> Qos:
    if tree is None:
        return Qos()
    fields = Fields(tree, "`qos`", QOS_KEYS, faults)
    return Qos(
        reliability=fields.one_of("reliability", ("reliable", "best_effort")),
        durability=fields.one_of("durability", ("volatile", "transient_local")),
        history_depth=fields.count("history_depth"),
    )


def read_callback_groups(node: Fields, faults: Faults) -> tuple[CallbackGroup, ...]:
    """The callback groups that a node defines."""
    tree = node.mapping("callback_groups")
    if tree is None:
        return ()
    names = tuple(entry.key for entry in tree)
    fields = Fields(tree, "`callback_groups`", names, faults)
    return tuple(
        CallbackGroup(
            name=Spanned(entry.key, entry.key_span),
            type=fields.one_of(entry.key, CALLBACK_GROUP_TYPES),
        )
        for entry in tree
    )


LOG_LEVELS = ("debug", "info", "warn", "error", "fatal")
_SPECIAL_KEYS = {"robot": ROBOT_KEYS, "viz": VIZ_NODE_KEYS}


def read_node(tree: TreeMap, section: str, device: str, index: int, faults: Faults) -> Node:
    """Read a node of a section; invalid parts are omitted and reported."""
    keys = _SPECIAL_KEYS.get(section, NODE_KEYS)
    fields = Fields(tree, f"a node of `{section}`", keys, faults)
    own_device = fields.text("device")
    is_robot, is_viz = section == "robot", section == "viz"
    is_simulated = fields.boolean("is_simulated") if is_robot else None
    is_used = is_simulated is None or is_simulated.value
    of_sims = faults if is_used else []  # errors in an unused block are harmless
    return Node(
        section=section,
        device=own_device.value if own_device else device,
        index=index,
        span=fields.start,
        pkg=check_package(fields.text("pkg", required=True), faults),
        executable=fields.text("executable", required=True),
        name=check_node_name(fields.text("name"), faults),
        namespace=check_namespace(fields.text("namespace"), faults),
        params_path=fields.no_or_text("params_path"),
        params=read_params(fields.mapping("params"), faults),
        callback_groups=read_callback_groups(fields, faults),
        components=read_components(fields, faults),
        remappings=_read_remappings(fields, faults),
        env=_read_env(fields, faults),
        log_level=fields.one_of("log_level", LOG_LEVELS),
        respawn=fields.boolean("respawn"),
        on_crash=fields.one_of("on_crash", get_args(OnCrash)),
        is_simulated=is_simulated,
        sims=tuple(read_sim(sim, of_sims) for sim in fields.maps("sim")) if is_robot else (),
        robot_pkg=check_package(fields.no_or_text("robot_pkg"), faults) if is_viz else None,
        urdf=fields.text("urdf") if is_viz else None,
        robot_topic=check_topic(fields.text("robot_topic"), faults) if is_viz else None,
        tf_prefix=fields.text("tf_prefix") if is_viz else None,
    )


def _read_remappings(fields: Fields, faults: Faults) -> tuple[Remapping, ...]:
    """`{from: to}`, or a list of `from:=to`."""
    entry = fields.entry("remappings")
    if entry is None:
        return ()
    if isinstance(entry.value, TreeMap):
        pairs = [
            (Spanned(e.key, e.key_span), new)
            for e in entry.value
            if (new := read_text(f"remapping `{e.key}`", e.value, faults))
        ]
    else:
        items = entry.value.items if isinstance(entry.value, TreeList) else (entry.value,)
        pairs = [pair for item in items if (pair := _read_remapping(item, faults))]
    for old, new in pairs:
        # A prefix before a colon selects a node; `__ns` and similar are not topics.
        if ":" not in old.value and not old.value.startswith("__"):
            check_topic(old, faults)
        check_topic(new, faults)
    return tuple(Remapping(old=old.value, new=new.value, span=new.span) for old, new in pairs)


def _read_remapping(item: Tree, faults: Faults) -> tuple[Spanned[str], Spanned[str]] | None:
    text = item.value if isinstance(item, TreeScalar) else None
    old, sign, new = str(text).partition(":=")
    if isinstance(text, str) and old and sign and new:
        return Spanned(old, item.span), Spanned(new, item.span)
    message = f"a remapping is {kind_of(item)}, expected `from:=to`"
    faults.append(found("OBK103", message, item.span))
    return None


def _read_env(fields: Fields, faults: Faults) -> tuple[tuple[str, str], ...]:
    """Environment variables; a number counts as text."""
    pairs: list[tuple[str, str]] = []
    for entry in fields.mapping("env") or ():
        value = entry.value
        if isinstance(value, TreeScalar) and value.value is not None:
            text = value.value if isinstance(value.value, str) else value.text
            pairs.append((entry.key, text))
        else:
            message = f"environment variable `{entry.key}` is {kind_of(value)}, expected text"
            faults.append(found("OBK103", message, value.span))
    return tuple(pairs)
