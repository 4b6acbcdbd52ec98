"""`Parameter`: a value that can be tuned while its node runs, read as a plain attribute.

    class Balance(ObeliskController):
        kp = Parameter(20.0, ge=0.0, le=200.0, unit="N m/rad", description="proportional gain")

        def compute_control(self):
            u = -self.kp * error

The node's class stores the declarations separately. `LiveParameters` makes the values plain
attributes of the node and changes them between two callbacks. Reading one therefore costs no more
than reading any other attribute; even an empty descriptor would cost six times as much.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.parameter import Parameter as RosParameter

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_spec.parameter_notes import ParameterNotes

__all__ = ["Parameter", "parameters_of"]

T = TypeVar("T", bound=bool | int | float | str | Enum | Sequence[int] | Sequence[float])

_SCALARS: Final = {
    bool: RosParameter.Type.BOOL,
    int: RosParameter.Type.INTEGER,
    float: RosParameter.Type.DOUBLE,
    str: RosParameter.Type.STRING,
}
_DECLARED: Final = "_declared_parameters"
"""The class attribute that maps names to the class's own parameters."""
_SEPARATORS: Final = (";", "\n")
"""Characters that end a note in the descriptor."""


class Parameter(Generic[T]):
    """Declares a ROS parameter with the attribute's name, in the body of a node's class.

    The node's attribute holds the current value. A change takes effect between two callbacks; then
    the node's `on_parameters(changed)` method is called with the names of the changed parameters.
    """

    def __init__(
        self,
        default: T,
        *,
        ge: float | None = None,
        le: float | None = None,
        unit: str = "",
        description: str = "",
        live: bool = True,
    ) -> None:
        """Describe the parameter; the node declares it in its constructor.

        Args:
            default: used unless the config has a value; a bool, int, float, str, enum member, list
                or tuple of numbers. It sets the parameter's type, and for a tuple also its length.
                For an enum, ROS uses the members' values if all are strings, otherwise their names.
            ge: minimum of the number, or of each item in a list [`unit`].
            le: maximum of the number, or of each item in a list [`unit`].
            unit: shown with the value, such as `N m/rad`.
            description: one phrase for people who tune the value.
            live: whether a new value takes effect between two callbacks; if false, at the next
                `configure` transition.

        Raises:
            ObeliskConfigError: the default has an unsupported type or is out of range, or limits
                are given for a value that is not a number.
        """
        self.default = default
        self.description = description
        self.name = ""
        self._enum: type[Enum] | None = type(default) if isinstance(default, Enum) else None
        choices = () if self._enum is None else tuple(_texts(self._enum))
        self.notes = ParameterNotes(
            unit=unit,
            least=ge,
            most=le,
            choices=choices,
            length=len(default) if isinstance(default, tuple) else None,
            is_live=live,
        )
        """Limits, unit, and when a new value takes effect."""
        self.type = self._type_of_default()
        """The type of the ROS parameter."""
        self._check()

    def __set_name__(self, owner: type, name: str) -> None:
        """Store the attribute's name, and remove the class attribute in favor of the node's value.

        Raises:
            ObeliskConfigError: a base class uses the name for something else.
        """
        self.name = name
        for base in owner.__mro__[1:]:
            if name in base.__dict__:
                raise ObeliskConfigError(
                    f"the parameter `{name}` of {owner.__name__} hides {base.__name__}.{name}: "
                    "choose another name"
                )
        declared = {**owner.__dict__.get(_DECLARED, {}), name: self}
        setattr(owner, _DECLARED, declared)
        delattr(owner, name)

    if TYPE_CHECKING:

        def __get__(self, instance: object, owner: type) -> T: ...

    def descriptor(self, initial: RosParameter) -> ParameterDescriptor:
        """Build the description for ROS tools, including the initial value."""
        found = ParameterDescriptor(name=self.name, description=self.description)
        least, most = self.notes.least, self.notes.most
        has_range_field = least is not None and most is not None
        if least is not None and most is not None:
            if self.type is RosParameter.Type.DOUBLE:
                found.floating_point_range = [
                    FloatingPointRange(from_value=float(least), to_value=float(most))
                ]
            elif self.type is RosParameter.Type.INTEGER:
                found.integer_range = [
                    IntegerRange(from_value=math.ceil(least), to_value=math.floor(most))
                ]
            else:
                has_range_field = False
        notes = replace(self.notes, initial=_plain(initial.value))
        found.additional_constraints = notes.text(has_range_field=has_range_field)
        return found

    def to_ros(self) -> RosParameter:
        """Return the default as a ROS parameter."""
        value: Any = self.default
        if isinstance(value, Enum):
            value = _text(value)
        elif self.type is RosParameter.Type.DOUBLE:
            value = float(value)
        elif self.type is RosParameter.Type.DOUBLE_ARRAY:
            value = [float(item) for item in value]
        elif self.type is RosParameter.Type.INTEGER_ARRAY:
            value = list(value)
        return RosParameter(self.name, self.type, value)

    def fit(self, parameter: RosParameter) -> RosParameter:
        """Convert a value to the parameter's type: `20` becomes `20.0` for a float."""
        value = parameter.value
        if self.type is RosParameter.Type.DOUBLE and type(value) is int:
            return RosParameter(self.name, self.type, float(value))
        is_list = parameter.type_ is RosParameter.Type.INTEGER_ARRAY
        if self.type is RosParameter.Type.DOUBLE_ARRAY and is_list:
            return RosParameter(self.name, self.type, [float(item) for item in value])
        return parameter

    def fault(self, parameter: RosParameter) -> str | None:
        """Why a value is invalid ("`kp` is 500.0, expected 0.0 to 200.0"); None if it is valid."""
        if parameter.type_ is not self.type:
            kinds = (kind.name.lower() for kind in (parameter.type_, self.type))
            return "`{}` is of type {}, expected {}".format(self.name, *kinds)
        fault = self.notes.fault(_plain(parameter.value))
        return None if fault is None else f"`{self.name}` {fault}"

    def value(self, parameter: RosParameter) -> Any:
        """Convert a ROS value to the value of the attribute."""
        if self._enum is not None:
            return _texts(self._enum)[parameter.value]
        value = _plain(parameter.value)
        return tuple(value) if isinstance(self.default, tuple) else value

    def _type_of_default(self) -> RosParameter.Type:
        value = self.default
        if isinstance(value, Enum):
            return RosParameter.Type.STRING
        found = _SCALARS.get(type(value))
        if found is not None:
            return found
        if isinstance(value, list | tuple) and value:
            if all(type(item) is int for item in value):
                return RosParameter.Type.INTEGER_ARRAY
            if all(type(item) in (int, float) for item in value):
                return RosParameter.Type.DOUBLE_ARRAY
        raise ObeliskConfigError(
            f"the default of a parameter is {value!r}, expected a bool, int, float, str, "
            "enum member or list of numbers"
        )

    def _check(self) -> None:
        notes = self.notes
        is_number = self.type.name.startswith(("INTEGER", "DOUBLE"))
        if notes.range and not is_number:
            raise ObeliskConfigError(f"`ge` and `le` limit numbers, not {self.default!r}")
        if notes.least is not None and notes.most is not None and notes.least > notes.most:
            raise ObeliskConfigError(f"`ge` is {notes.least}, greater than `le` ({notes.most})")
        if any(separator in notes.unit for separator in _SEPARATORS):
            raise ObeliskConfigError(f"the unit is {notes.unit!r}, expected one line without `;`")
        fault = notes.fault(_plain(self.to_ros().value))
        if fault is not None:
            raise ObeliskConfigError(f"the default of a parameter {fault}")


def parameters_of(node_class: type) -> dict[str, Parameter[Any]]:
    """Return the parameters of a class by name, those of base classes first."""
    found: dict[str, Parameter[Any]] = {}
    for base in reversed(node_class.__mro__):
        # A subclass may replace a parameter with a constant.
        found = {name: one for name, one in found.items() if name not in base.__dict__}
        found.update(base.__dict__.get(_DECLARED, {}))
    return found


def _plain(value: Any) -> Any:
    """Convert rclpy's array types to lists."""
    return value if isinstance(value, bool | int | float | str) else list(value)


def _texts(enum: type[Enum]) -> dict[str, Enum]:
    """Map the names that ROS uses to the enum's members."""
    return {_text(member): member for member in enum}


def _text(member: Enum) -> str:
    is_text = all(isinstance(other.value, str) for other in type(member))
    return str(member.value) if is_text else member.name
