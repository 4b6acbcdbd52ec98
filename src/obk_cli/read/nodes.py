"""One node: of a section, or of `viz`."""

from obk_cli.config import Node, Spanned
from obk_cli.diagnostics import found
from obk_cli.read.components import read_callback_groups, read_components
from obk_cli.read.fields import Faults, Fields, read_text
from obk_cli.read.keys import NODE_KEYS, ROBOT_KEYS, VIZ_NODE_KEYS
from obk_cli.read.names import check_namespace, check_node_name, check_package, check_topic
from obk_cli.read.params import read_params
from obk_cli.read.sim import read_sim
from obk_cli.tree import Tree, TreeList, TreeMap, TreeScalar, kind_of

__all__ = ["LOG_LEVELS", "read_node"]

LOG_LEVELS = ("debug", "info", "warn", "error", "fatal")
_ON_CRASH = ("stop", "restart", "ignore")
_SPECIAL_KEYS = {"robot": ROBOT_KEYS, "viz": VIZ_NODE_KEYS}


def read_node(tree: TreeMap, section: str, device: str, index: int, faults: Faults) -> Node:
    """A node of a section; what of it is wrong becomes findings and is left out."""
    keys = _SPECIAL_KEYS.get(section, NODE_KEYS)
    fields = Fields(tree, f"a node of `{section}`", keys, faults)
    own_device = fields.text("device")
    is_robot, is_viz = section == "robot", section == "viz"
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
        on_crash=fields.one_of("on_crash", _ON_CRASH),
        is_simulated=fields.boolean("is_simulated") if is_robot else None,
        sims=tuple(read_sim(sim, faults) for sim in fields.maps("sim")) if is_robot else (),
        robot_pkg=check_package(fields.no_or_text("robot_pkg"), faults) if is_viz else None,
        urdf=fields.text("urdf") if is_viz else None,
        robot_topic=check_topic(fields.text("robot_topic"), faults) if is_viz else None,
        tf_prefix=fields.text("tf_prefix") if is_viz else None,
    )


def _read_remappings(fields: Fields, faults: Faults) -> tuple[tuple[str, str], ...]:
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
        # Before a colon stands whom it is for; `__ns` and the like are no topics.
        if ":" not in old.value and not old.value.startswith("__"):
            check_topic(old, faults)
        check_topic(new, faults)
    return tuple((old.value, new.value) for old, new in pairs)


def _read_remapping(item: Tree, faults: Faults) -> tuple[Spanned[str], Spanned[str]] | None:
    text = item.value if isinstance(item, TreeScalar) else None
    old, sign, new = str(text).partition(":=")
    if isinstance(text, str) and old and sign and new:
        return Spanned(old, item.span), Spanned(new, item.span)
    message = f"a remapping is {kind_of(item)}, expected `from:=to`"
    faults.append(found("OBK103", message, item.span))
    return None


def _read_env(fields: Fields, faults: Faults) -> tuple[tuple[str, str], ...]:
    """Environment variables; a number counts as its text."""
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
