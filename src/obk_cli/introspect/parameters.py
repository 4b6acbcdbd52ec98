"""Values of ROS parameters: from what a user types, as the parameter's type wants it.

In: YAML and the type that the parameter has. Out: type and value. Asks no node.
Source: rcl_interfaces/msg/ParameterType.
"""

from dataclasses import dataclass
from typing import Final

from obelisk_spec.suggestions import with_article
from obelisk_spec.values import ParameterValue
from obk_cli.errors import MisuseError

__all__ = ["KINDS", "NOT_SET", "NodeParameter", "fit_parameter", "parse_parameter", "refusal"]

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
"""The types by their numbers."""
ARRAY: Final = "_array"
LEAST: Final = -(2**63)
_WRONG_TYPE: Final = "Wrong parameter type"
"""Begins what rclpy and rclcpp say of it, in words and braces of their own code."""
_SWITCHES: Final = {"on": True, "yes": True, "off": False, "no": False}
"""Words that the parameter files of ROS take for a truth value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeParameter:
    """A parameter's value."""

    kind: str
    """One of `KINDS`."""
    value: ParameterValue | None
    """None: not set. A byte array is a tuple of integers."""


def parse_parameter(text: str) -> NodeParameter:
    """The value that a text stands for, as the parameter files of ROS have it.

    Raises:
        MisuseError: it is none, or none that a parameter can have.
    """
    # Who only looks at parameters needs no parser.
    from obelisk_spec.yaml_core import YamlTextError, load_yaml_core

    try:
        value = load_yaml_core(text)
    except YamlTextError as error:
        raise MisuseError(
            f"`{text}` is not YAML: {error}", help="put it in quotes to have it as a string"
        ) from error
    if isinstance(value, list):
        return _array(text, value)
    kind = _kind(value)
    if kind is None:
        raise MisuseError(
            f"`{text}` is no value of a parameter",
            help='expected a bool, a number, a string or a list of one of them; "" is no text',
        )
    return NodeParameter(kind=kind, value=value)  # type: ignore[arg-type]


def fit_parameter(text: str, given: NodeParameter, wanted: str) -> NodeParameter:
    """What was given, as the type of the parameter takes it; unchanged where it does not.

    Args:
        text: as the user has it.
        given: what it stands for.
        wanted: the parameter's type, one of `KINDS`.
    """
    value = given.value
    if wanted == "double" and isinstance(value, int) and not isinstance(value, bool):
        return NodeParameter(kind=wanted, value=float(value))
    if wanted == "bool" and isinstance(value, str) and value.lower() in _SWITCHES:
        return NodeParameter(kind=wanted, value=_SWITCHES[value.lower()])
    if wanted == "string" and not isinstance(value, str | tuple):
        return NodeParameter(kind=wanted, value=text)
    if isinstance(value, tuple) and wanted.endswith(ARRAY):
        if not value:
            return NodeParameter(kind=wanted, value=())
        if wanted == "double_array" and given.kind == "integer_array":
            return NodeParameter(kind=wanted, value=tuple(float(item) for item in value))
        if wanted == "byte_array" and all(isinstance(i, int) and 0 <= i < 256 for i in value):
            return NodeParameter(kind=wanted, value=value)
    return given


def refusal(reason: str, given: NodeParameter) -> str:
    """Why a node refuses a value, in its own words unless they are those of a ROS library."""
    wrong_type = f"{with_article(given.kind)} was given"
    return wrong_type if reason.startswith(_WRONG_TYPE) else reason


def _array(text: str, items: list[object]) -> NodeParameter:
    kinds = {_kind(item) for item in items}
    if kinds == {"integer", "double"}:
        kinds, items = {"double"}, [float(item) for item in items]  # type: ignore[arg-type]
    # Nothing tells the type of an empty list; this is what ROS takes it for.
    kind = kinds.pop() if len(kinds) == 1 else "bool" if not items else None
    if kind is None:
        raise MisuseError(
            f"`{text}` is no value of a parameter",
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
