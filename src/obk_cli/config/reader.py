"""Read the whole config: its name, its devices in either syntax, and its sections."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace

from obelisk_spec.suggestions import did_you_mean, list_names, near_names, sure_name
from obk_cli.config.fields import (
    EXTERNAL_TOPIC_KEYS,
    JOYSTICK_KEYS,
    OBK_KEYS,
    RAY_CASTER_KEYS,
    RESERVED_KEYS,
    SECTION_KEYS,
    VIZ_KEYS,
    Faults,
    Fields,
    check_package,
    check_topic,
    read_items,
    read_text,
)
from obk_cli.config.fixes import respell
from obk_cli.config.model import (
    NODE_SECTIONS,
    ONE_DEVICE,
    ConfigParameter,
    ExternalTopic,
    Joystick,
    Node,
    Spanned,
    Stack,
)
from obk_cli.config.node_reader import read_node
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap, TreeScalar, kind_of
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.source import Span

__all__ = ["is_device", "read_stack"]


def read_stack(tree: Tree) -> tuple[Stack | None, tuple[Diagnostic, ...]]:
    """The typed config; None if the text is not a config at all."""
    faults: Faults = []
    if not isinstance(tree, TreeMap) or not _is_config(tree):
        return None, (_not_a_config(tree),)
    reader = _StackReader(faults)
    devices = [entry for entry in tree if is_device(entry)]
    sections = [section for entry in tree if (section := _as_section(entry, tree))]
    if devices and sections:
        faults.append(_mixed(devices[0], sections[0]))
    for device in devices:
        reader.read_device(device)
    for section in sections:
        reader.read_section(section, ONE_DEVICE)
    known = (*RESERVED_KEYS, *(device.key for device in devices))
    top = Fields(tree, "a config", known, faults)
    obk = top.mapping("obk")
    settings = Fields(obk, "`obk`", OBK_KEYS, faults) if obk else None
    stack = Stack(
        name=top.text("config"),
        nodes=tuple(reader.nodes),
        span=top.start,
        joysticks=tuple(reader.joysticks),
        external_topics=tuple(_read_external_topics(top, faults)),
        ignored_codes=_read_ignored(settings, faults),
        use_sim_time=settings.boolean("use_sim_time") if settings else None,
    )
    return stack, tuple(faults)


def is_device(entry: Entry) -> bool:
    """Whether a top-level key is a device: not reserved, and with a section inside."""
    if entry.key in RESERVED_KEYS or not isinstance(entry.value, TreeMap):
        return False
    return any(inner.key in SECTION_KEYS for inner in entry.value)


def _as_section(entry: Entry, tree: TreeMap) -> Entry | None:
    """The section that a top-level key names, possibly misspelled."""
    if entry.key in SECTION_KEYS:
        return entry
    if entry.key in RESERVED_KEYS or is_device(entry) or isinstance(entry.value, TreeScalar):
        return None
    near = near_names(entry.key, SECTION_KEYS)
    return replace(entry, key=near[0]) if near and tree.get(near[0]) is None else None


def _is_config(tree: TreeMap) -> bool:
    """Whether the mapping is meant as a config: it has a key of the language, or a similar one."""
    if not tree.entries or any(entry.key in RESERVED_KEYS or is_device(entry) for entry in tree):
        return True
    is_ray_caster = any(entry.key in RAY_CASTER_KEYS for entry in tree)
    return not is_ray_caster and any(near_names(entry.key, RESERVED_KEYS) for entry in tree)


def _not_a_config(tree: Tree) -> Diagnostic:
    if isinstance(tree, TreeScalar) and tree.value in (None, ""):
        return found("OBK114", "the file is empty", tree.span)
    if not isinstance(tree, TreeMap):
        return found("OBK114", f"the file contains {kind_of(tree)}, not a config", tree.span)
    span = tree.entries[0].key_span
    if any(entry.key in RAY_CASTER_KEYS for entry in tree):
        message = "this is a ray-caster file, not a config"
        help = "refer to it as `config_path` in the sensor group that uses it"
        return found("OBK114", message, span, help=help)
    keys = list_names(entry.key for entry in tree)
    message = f"the file contains {keys}, none of which is a section of a config"
    return found("OBK114", message, span, help=f"the sections are {list_names(SECTION_KEYS)}")


def _mixed(device: Entry, section: Entry) -> Diagnostic:
    return found(
        "OBK112",
        f"section `{section.key}` is at the top level although the config has the device "
        f"`{device.key}`",
        section.key_span,
        help=f"move it into `{device.key}`, or move the device's sections to the top level",
        related=(Related(message="the device", span=device.key_span),),
    )


def _read_ignored(settings: Fields | None, faults: Faults) -> tuple[Spanned[str], ...]:
    entry = settings.entry("ignore") if settings else None
    if entry is None:
        return ()
    items = entry.value.items if isinstance(entry.value, TreeList) else (entry.value,)
    codes = (read_text("a code of `ignore`", item, faults) for item in items)
    return tuple(code for code in codes if code is not None)


def _read_external_topics(top: Fields, faults: Faults) -> Iterator[ExternalTopic]:
    """A list of names, or a mapping from names to properties of the topics."""
    entry = top.entry("external_topics")
    if entry is None:
        return
    match entry.value:
        case TreeMap() as topics:
            for named in topics:
                yield _read_external_topic(named, faults)
        case TreeList(items=items):
            for item in items:
                name = read_text("a topic of `external_topics`", item, faults)
                if name is not None:
                    yield ExternalTopic(topic=_external_name(name, faults))
        case other:
            message = (
                f"`external_topics` is {kind_of(other)}, expected a list of topics or a mapping"
            )
            faults.append(found("OBK103", message, other.span))


def _external_name(name: Spanned[str], faults: Faults) -> Spanned[str]:
    if name.value.startswith("~"):
        message = (
            f"`{name.value}` cannot be an external topic, because `~` stands for a node of the "
            "stack"
        )
        faults.append(found("OBK109", message, name.span))
    else:
        check_topic(name, faults)
    return name


def _read_external_topic(named: Entry, faults: Faults) -> ExternalTopic:
    name = _external_name(Spanned(named.key, named.key_span), faults)
    topic = ExternalTopic(topic=name)
    if isinstance(named.value, TreeScalar) and named.value.value is None:
        return topic
    if not isinstance(named.value, TreeMap):
        message = f"external topic `{named.key}` is {kind_of(named.value)}, expected a mapping"
        help = "write `{msg_type: ...}`, or leave it empty"
        faults.append(found("OBK103", message, named.value.span, help=help))
        return topic
    fields = Fields(named.value, "an external topic", EXTERNAL_TOPIC_KEYS, faults)
    direction = fields.one_of("direction", ("published", "subscribed"))
    return replace(topic, msg_type=fields.text("msg_type"), direction=direction)


def _read_joystick_params(fields: Fields) -> tuple[ConfigParameter, ...]:
    """The parameters of ROS's `joy_node`, with the types that it declares."""
    read: Mapping[str, Spanned[int] | Spanned[float] | Spanned[str] | Spanned[bool] | None] = {
        "device_id": fields.count("device_id", least=0),
        "device_name": fields.any_text("device_name"),
        "deadzone": fields.number("deadzone", least=0, most=1),
        "autorepeat_rate": fields.number("autorepeat_rate", least=0, most=1000),
        "sticky_buttons": fields.boolean("sticky_buttons"),
        "coalesce_interval_ms": fields.count("coalesce_interval_ms", least=0),
    }
    return tuple(
        ConfigParameter(name=name, value=given.value, span=given.span, key_span=given.key_span)
        for name, given in read.items()
        if given is not None
    )


class _StackReader:
    """Collects the nodes of all devices; nodes are numbered across devices."""

    def __init__(self, faults: Faults) -> None:
        self.nodes: list[Node] = []
        self.joysticks: list[Joystick] = []
        self._faults = faults
        self._counts: Counter[str] = Counter()

    def read_device(self, device: Entry) -> None:
        """Read all sections of a device."""
        assert isinstance(device.value, TreeMap)  # checked by `is_device`
        for entry in device.value:
            section = _as_section(entry, device.value)
            if section is not None:
                self.read_section(section, device.key)
            if section is not entry:
                help = did_you_mean(entry.key, SECTION_KEYS)
                message = f"device `{device.key}` has no section `{entry.key}`"
                meant = sure_name(entry.key, SECTION_KEYS)
                edits = respell(entry.key_span, entry.key, meant) if meant else ()
                self._faults.append(found("OBK101", message, entry.key_span, help=help, fix=edits))

    def read_section(self, section: Entry, device: str) -> None:
        """Read one section of a device."""
        if isinstance(section.value, TreeScalar) and section.value.value is None:
            return
        if section.key in NODE_SECTIONS:
            self._read_nodes(section.key, section.value, section.key, device)
        elif not isinstance(section.value, TreeMap):
            message = f"`{section.key}` is {kind_of(section.value)}, expected a mapping"
            self._faults.append(found("OBK103", message, section.value.span))
        elif section.key == "viz":
            self._read_viz(section.value, device)
        else:
            self._read_joystick(section.value, section.key_span, device)

    def _read_nodes(self, key: str, tree: Tree, section: str, device: str) -> None:
        for item in read_items(key, tree, self._faults):
            index = self._counts[section]
            self._counts[section] += 1
            self.nodes.append(read_node(item, section, device, index, self._faults))

    def _read_viz(self, tree: TreeMap, device: str) -> None:
        fields = Fields(tree, "`viz`", VIZ_KEYS, self._faults)
        check_package(fields.no_or_text("rviz_pkg"), self._faults)
        fields.text("rviz_config")
        on = fields.boolean("on")
        nodes = fields.entry("viz_nodes")
        if nodes is not None and (on is None or on.value):
            self._read_nodes("viz_nodes", nodes.value, "viz", device)

    def _read_joystick(self, tree: TreeMap, span: Span, device: str) -> None:
        fields = Fields(tree, "`joystick`", JOYSTICK_KEYS, self._faults)
        on = fields.boolean("on")
        joystick = Joystick(
            on=on is None or on.value,
            device=device,
            span=span,
            pub_topic=check_topic(fields.text("pub_topic"), self._faults),
            sub_topic=check_topic(fields.text("sub_topic"), self._faults),
            params=_read_joystick_params(fields),
        )
        self.joysticks.append(joystick)
