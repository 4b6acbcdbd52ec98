"""Read and set a node's parameters over its services: names, values, types.

Source: rcl_interfaces/srv.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from obelisk_spec.parameter_notes import ParameterNotes, parse_notes
from obelisk_spec.suggestions import with_article
from obelisk_spec.values import ParameterValue
from obk_cli.errors import MisuseError
from obk_cli.ros.participant import RosParticipant
from obk_cli.ros.services import ServiceClient
from obk_cli.ros.types import find_type

__all__ = [
    "KINDS",
    "MODULES",
    "NOT_SET",
    "UNDESCRIBED",
    "NodeParameter",
    "NodeParameters",
    "ParameterDescription",
    "SetAnswer",
    "fit_parameter",
    "parse_parameter",
    "refusal",
]

NOT_SET: Final = "not set"
KINDS: Final = (
    NOT_SET,
    "bool",
    "integer",
    "double",
    "string",
    "byte_array",
    "bool_array",
    "integer_array",
    "double_array",
    "string_array",
)
"""Parameter types by number."""
ARRAY: Final = "_array"
LEAST: Final = -(2**63)
_WRONG_TYPE: Final = "Wrong parameter type"
"""Prefix of the reason that rclpy and rclcpp give, followed by details of their own code."""
_WAITING: Final = "accepted"
"""Prefix of the reason if a value is not in effect yet; see `LiveParameters` in `obelisk_py`."""
_FAILED: Final = "set, but"
"""Prefix of the reason if the node failed because of the new value; from there too."""
_SWITCHES: Final = {"on": True, "yes": True, "off": False, "no": False}
"""Words that ROS parameter files treat as booleans."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeParameter:
    """A parameter's value."""

    kind: str
    """One of `KINDS`."""
    value: ParameterValue | None
    """None: not set. A byte array is a tuple of integers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterDescription:
    """A node's description of one of its parameters."""

    kind: str
    """The declared type, one of `KINDS`."""
    notes: ParameterNotes = ParameterNotes()  # noqa: RUF009 - frozen
    """Limits, unit, and when a new value takes effect, as far as the node reports them."""
    text: str = ""


UNDESCRIBED: Final = ParameterDescription(kind=NOT_SET)
"""Replaces the description of a parameter that the node does not describe."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SetAnswer:
    """A node's answer to a request to set a parameter."""

    successful: bool
    reason: str
    """Why not, or when the new value takes effect; empty if the node gives no reason."""

    @property
    def is_waiting(self) -> bool:
        """Whether the value takes effect only after running callbacks have ended."""
        return self.successful and self.reason.startswith(_WAITING)

    @property
    def has_failed(self) -> bool:
        """Whether the value is set, but the node failed because of it."""
        return self.successful and self.reason.startswith(_FAILED)


def parse_parameter(text: str) -> NodeParameter:
    """Parse a value as in ROS parameter files.

    Raises:
        MisuseError: the text is not valid YAML, or not a valid parameter value.
    """
    # Commands that only read parameters need no parser.
    from obelisk_spec.yaml_core import YamlTextError, load_yaml_core

    try:
        value = load_yaml_core(text)
    except YamlTextError as error:
        raise MisuseError(
            f"`{text}` is not valid YAML: {error}", help="to use it as a string, put it in quotes"
        ) from error
    if isinstance(value, list):
        return _array(text, value)
    kind = _kind(value)
    if kind is None:
        raise MisuseError(
            f"`{text}` is not a valid parameter value",
            help="expected a bool, a number, a string or a list of one of them; "
            '"" is an empty string',
        )
    return NodeParameter(kind=kind, value=value)  # type: ignore[arg-type]


def fit_parameter(text: str, given: NodeParameter, kind: str) -> NodeParameter:
    """Convert a value to the type of the parameter; unchanged if that is impossible.

    Args:
        text: as written by the user.
        given: the parsed value.
        kind: the parameter's type, one of `KINDS`.
    """
    value = given.value
    if kind == "double" and isinstance(value, int) and not isinstance(value, bool):
        return NodeParameter(kind=kind, value=float(value))
    if kind == "bool" and isinstance(value, str) and value.lower() in _SWITCHES:
        return NodeParameter(kind=kind, value=_SWITCHES[value.lower()])
    if kind == "string" and not isinstance(value, str | tuple):
        return NodeParameter(kind=kind, value=text)
    if isinstance(value, tuple) and kind.endswith(ARRAY):
        if not value:
            return NodeParameter(kind=kind, value=())
        if kind == "double_array" and given.kind == "integer_array":
            return NodeParameter(kind=kind, value=tuple(float(item) for item in value))
        if kind == "byte_array" and all(isinstance(i, int) and 0 <= i < 256 for i in value):
            return NodeParameter(kind=kind, value=value)
    return given


def refusal(reason: str, given: NodeParameter) -> str:
    """Why a node rejects a value, in its own words unless they are those of a ROS library."""
    wrong_type = f"{with_article(given.kind)} was given"
    return wrong_type if reason.startswith(_WRONG_TYPE) else reason or "no reason given"


def _array(text: str, items: list[object]) -> NodeParameter:
    kinds = {_kind(item) for item in items}
    if kinds == {"integer", "double"}:
        kinds, items = {"double"}, [float(item) for item in items]  # type: ignore[arg-type]
    # An empty list has no type of its own; ROS treats it as this one.
    kind = kinds.pop() if len(kinds) == 1 else "bool" if not items else None
    if kind is None:
        raise MisuseError(
            f"`{text}` is not a valid parameter value",
            help="expected a list of bools, of numbers or of strings, not of several types",
        )
    return NodeParameter(kind=f"{kind}{ARRAY}", value=tuple(items))  # type: ignore[arg-type]


def _kind(value: object) -> str | None:
    match value:
        case bool():
            return "bool"
        case int():
            return "integer" if LEAST <= value < -LEAST else None
        case float():
            return "double"
        case str():
            return "string"
    return None


PACKAGE: Final = "rcl_interfaces"
MODULES: Final = ("rosidl_generator_py", f"{PACKAGE}.msg", f"{PACKAGE}.srv")
"""Modules to import before a node can be queried."""


class NodeParameters:
    """The parameters of one node; every query has the same time limit."""

    def __init__(self, participant: RosParticipant, node: str, timeout_s: float) -> None:
        """Prepare; queries follow on demand.

        Args:
            participant: the participant that sends queries.
            node: full name.
            timeout_s: limit for each answer [s].
        """
        self._participant = participant
        self._node = node
        self._timeout_s = timeout_s

    def names(self) -> tuple[str, ...]:
        """The names of all parameters.

        Raises:
            CommandFailedError: the node does not answer.
        """
        response = self._ask("ListParameters", "list_parameters", depth=0)
        return tuple(sorted(response.result.names))

    def values(self, names: Sequence[str]) -> Mapping[str, NodeParameter]:
        """The values of these parameters; `not set` if the node does not have one.

        Raises:
            CommandFailedError: the node does not answer.
        """
        values = self._values(names)
        if len(values) != len(names):
            # If one has no value, rclpy nodes return no values at all, so request each alone.
            values = [next(iter(self._values([name])), None) for name in names]
        return {name: _parameter(value) for name, value in zip(names, values, strict=True)}

    def describe(self, names: Sequence[str]) -> Mapping[str, ParameterDescription]:
        """Descriptions of these parameters; names that the node does not have are omitted.

        Raises:
            CommandFailedError: the node does not answer.
        """
        response = self._ask("DescribeParameters", "describe_parameters", names=list(names))
        return {one.name: _description(one) for one in response.descriptors if one.name in names}

    def set(self, name: str, parameter: NodeParameter) -> SetAnswer:
        """Set a parameter.

        Raises:
            CommandFailedError: the node does not answer.
        """
        client = self._client("SetParameters", "set_parameters")
        message = find_type(f"{PACKAGE}/msg/Parameter")(name=name)
        message.value.type = KINDS.index(parameter.kind)
        if parameter.kind != NOT_SET:
            setattr(message.value, f"{parameter.kind}_value", _for_message(parameter))
        request = find_type(f"{PACKAGE}/srv/SetParameters").Request(parameters=[message])
        result = client.call(request, self._timeout_s).results[0]
        return SetAnswer(successful=bool(result.successful), reason=str(result.reason))

    def _values(self, names: Sequence[str]) -> Sequence[Any]:
        response = self._ask("GetParameters", "get_parameters", names=list(names))
        values: Sequence[Any] = response.values
        return values

    def _ask(self, kind: str, service: str, **fields: Any) -> Any:
        request = find_type(f"{PACKAGE}/srv/{kind}").Request(**fields)
        return self._client(kind, service).call(request, self._timeout_s, is_question=True)

    def _client(self, kind: str, service: str) -> ServiceClient:
        python_type = find_type(f"{PACKAGE}/srv/{kind}")
        return ServiceClient(self._participant, f"{self._node}/{service}", python_type)


def _description(descriptor: Any) -> ParameterDescription:
    notes = parse_notes(descriptor.additional_constraints)
    for limits in (*descriptor.floating_point_range, *descriptor.integer_range):
        least, most = (
            limit if math.isfinite(limit) else None
            for limit in (limits.from_value, limits.to_value)
        )
        notes = replace(notes, least=least, most=most)
    return ParameterDescription(
        kind=KINDS[descriptor.type], notes=notes, text=descriptor.description
    )


def _parameter(message: Any) -> NodeParameter:
    kind = KINDS[message.type] if message is not None else NOT_SET
    if kind == NOT_SET:
        return NodeParameter(kind=kind, value=None)
    value = getattr(message, f"{kind}_value")
    if kind == "byte_array":
        return NodeParameter(kind=kind, value=tuple(byte[0] for byte in value))
    return NodeParameter(kind=kind, value=tuple(value) if kind.endswith("_array") else value)


def _for_message(parameter: NodeParameter) -> Any:
    if not isinstance(parameter.value, tuple):
        return parameter.value
    if parameter.kind == "byte_array":
        return [bytes([int(byte)]) for byte in parameter.value]
    return list(parameter.value)
