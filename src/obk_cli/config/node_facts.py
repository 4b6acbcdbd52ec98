"""What a node's Python source says of the node, as values: components, parameters, what is amiss.

Made by reading source, never by running it; what cannot be known that way is said to be unknown.
"""

from dataclasses import dataclass
from typing import Final

from obelisk_spec.components import SETTING_SUFFIX, component_identity, component_spellings
from obk_cli.config.model import Component, ComponentKind
from obk_cli.diagnostics.source import Span

__all__ = [
    "CodeComponent",
    "CodeFault",
    "CodeParameter",
    "ControlLength",
    "MissingMethod",
    "NodeFacts",
    "kind_of_value",
]

_KINDS: Final = {bool: "bool", int: "int", float: "float", str: "text"}


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeComponent:
    """One `register_obk_...` call."""

    kind: ComponentKind
    ros_parameter: str | None
    key: str | None
    msg_type: str | None
    """Full, None where the config decides or the code computes it."""
    is_required: bool
    """Whether configure fails without settings; False too where that is not known."""
    is_optional: bool
    """Whether the code says that it may be left out."""
    has_default: bool
    """Whether the code brings settings of its own."""
    is_named_in_full: bool
    """Whether both names are known; else the config may use one that is computed."""
    is_of_library: bool
    """Whether a base class of the run-time library registers it."""
    span: Span
    """The line of the call."""

    @property
    def names(self) -> frozenset[str]:
        """Every spelling under which the config may name it."""
        given = (name for name in (self.ros_parameter, self.key) if name)
        return frozenset(spelling for name in given for spelling in component_spellings(name))

    @property
    def name(self) -> str:
        """What the code calls it: the ROS parameter, else the key."""
        return self.ros_parameter or self.key or ""

    @property
    def written(self) -> tuple[str, str]:
        """How a config names it: `key` with its key, else `ros_parameter` with that."""
        if self.ros_parameter is None or self.ros_parameter.endswith(SETTING_SUFFIX):
            return "key", component_identity(self.name)
        return ("key", self.key) if self.key else ("ros_parameter", self.ros_parameter)


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeParameter:
    """A ROS parameter that the code declares."""

    name: str
    kind: str | None
    """As `kind_of_value` has it, None where the code takes any or computes it."""
    span: Span
    """The line of the call."""


def kind_of_value(value: object) -> str | None:
    """Of which kind a parameter with this value is, `float` or `list of ints`; None: of none."""
    if isinstance(value, list | tuple):
        kinds = {_KINDS.get(type(item)) for item in value}
        kind = kinds.pop() if len(kinds) == 1 else None
        return f"list of {kind}s" if kind else None
    return _KINDS.get(type(value))


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingMethod:
    """An abstract method that the class leaves out."""

    name: str
    span: Span
    """Where it is declared."""
    near: tuple[str, ...] = ()
    """Methods of the class that look like it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlLength:
    """How many controls the code writes into a control message."""

    field: str
    length: int
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeFacts:
    """The class that an executable spins."""

    class_name: str
    span: Span
    """The `class` line."""
    components: tuple[CodeComponent, ...]
    parameters: tuple[CodeParameter, ...]
    """The ROS parameters that it declares itself, each once."""
    knows_components: bool
    """Whether `components` is all there can be."""
    knows_parameters: bool
    """Whether `parameters` is all there can be."""
    missing_methods: tuple[MissingMethod, ...] = ()
    control_lengths: tuple[ControlLength, ...] = ()
    can_damp: bool | None = None
    """Whether a robot implements `apply_damping`; None for other nodes, or if unknown."""

    def component_of(self, component: Component) -> CodeComponent | None:
        """What the code registers for a component of the config."""
        written = {name.value for name in (component.ros_parameter, component.key) if name}
        same_kind = (c for c in self.components if c.kind == component.kind)
        return next((c for c in same_kind if not written.isdisjoint(c.names)), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeFault:
    """Source that cannot be read as a node."""

    message: str
    """Of the source: "is not Python: ..."."""
    place: str
    """The file, for the sentence."""
    span: Span | None = None
    help: str | None = None
