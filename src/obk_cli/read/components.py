"""Publishers, subscribers, timers and callback groups of a node."""

from obelisk_spec.components import CALLBACK_GROUP_TYPES, STALE_ACTIONS
from obk_cli.config import COMPONENT_LISTS, CallbackGroup, Component, ComponentKind, Qos, Spanned
from obk_cli.diagnostics import found
from obk_cli.read.fields import Faults, Fields
from obk_cli.read.keys import COMPONENT_KEYS, QOS_KEYS, TIMER_KEYS
from obk_cli.read.names import check_topic
from obk_cli.tree import TreeMap

__all__ = ["read_callback_groups", "read_components"]


def read_components(node: Fields, faults: Faults) -> tuple[Component, ...]:
    """All components of a node, publishers first."""
    return tuple(
        _read_component(tree, kind, faults)
        for key, kind in COMPONENT_LISTS.items()
        for tree in node.maps(key)
    )


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
    return Component(
        kind=kind,
        span=fields.start,
        tree=tree,
        ros_parameter=ros_parameter,
        key=key,
        callback_group=group,
        topic=check_topic(fields.text("topic", required=True), faults),
        msg_type=fields.text("msg_type"),
        history_depth=fields.count("history_depth"),
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
