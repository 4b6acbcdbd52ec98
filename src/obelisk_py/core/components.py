"""Register a node's publishers, subscriptions and timers, and look them up by name.

The node's constructor registers the components; the `configure` transition creates their ROS
handles.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from reprlib import Repr
from typing import Any, Final, Generic, TypedDict, TypeVar

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_spec.components import component_spellings
from obelisk_spec.registration import (
    EXPECTED,
    ArgumentKind,
    RegistrationArgumentError,
    bind_registration,
    is_expected,
)
from obelisk_spec.suggestions import with_article

__all__ = [
    "ComponentKind",
    "ComponentTable",
    "RegisteredComponent",
    "RegistrationArguments",
    "registered_component",
    "spellings",
]

T = TypeVar("T")


class ComponentKind(Enum):
    """A kind of component; the value is the name of its list in `obelisk_settings`."""

    PUBLISHER = "publishers"
    SUBSCRIPTION = "subscribers"
    TIMER = "timers"

    @property
    def noun(self) -> str:
        """The kind's name in messages."""
        return self.name.lower()


def spellings(*names: str | None) -> frozenset[str]:
    """Return every spelling of the given names; None is skipped."""
    return frozenset(s for name in names if name for s in component_spellings(name))


class RegistrationArguments(TypedDict, total=False):
    """The keyword arguments of `register_obk_*`; a timer has no `msg_type`."""

    ros_parameter: str | None
    key: str | None
    callback: Callable[..., Any] | None
    msg_type: type[Any] | None
    default: str | Mapping[str, Any] | None
    default_config_str: str | None
    required: bool | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RegisteredComponent:
    """A component as registered by the code, before its settings are known."""

    kind: ComponentKind
    ros_parameter: str | None
    key: str | None
    callback: Callable[..., Any] | None = None
    msg_type: type[Any] | None = None
    default: str | Mapping[str, Any] | None = None
    required: bool | None = None
    """None for the default of the API generation that the call belongs to."""
    is_of_configure: bool = False
    """Whether `on_configure` registered it, so that `cleanup` unregisters it."""
    configuration: int = 0
    """How many times the node had been cleaned up when the component was registered."""

    def __str__(self) -> str:
        return f"{self.kind.noun} `{self.key or self.ros_parameter}`"

    @property
    def names(self) -> frozenset[str]:
        """Every name of the component, in all spellings."""
        return spellings(self.ros_parameter, self.key)


_SHORT: Final = Repr()
_SHORT.maxstring = _SHORT.maxother = 60


def registered_component(
    node_name: str, kind: ComponentKind, positional: Sequence[Any], named: Mapping[str, Any]
) -> RegisteredComponent:
    """Build the component that a `register_obk_*` call of any API generation registers.

    Raises:
        ObeliskConfigError: an argument is missing, unknown, given twice or of the wrong type.
    """
    method = f"register_obk_{kind.noun}"
    place = f"{method} of the node `{node_name}`"
    try:
        bound = bind_registration(method, positional, named, _described)
    except RegistrationArgumentError as error:
        raise ObeliskConfigError(f"{place}: {error}") from error
    for argument, value in bound.items():
        is_message = argument != "msg_type" or value is None or _is_message(value)
        if not (is_expected(argument, _described(value)) and is_message):
            raise ObeliskConfigError(
                f"{place}: `{argument}` is {_given(value)}, expected {EXPECTED[argument]}"
            )
    component = RegisteredComponent(
        kind=kind,
        ros_parameter=bound.get("ros_parameter") or None,
        key=bound.get("key") or None,
        callback=bound.get("callback"),
        msg_type=bound.get("msg_type"),
        default=bound.get("default"),
        required=bound.get("required"),
    )
    if not component.names:
        raise ObeliskConfigError(
            f"{place}: neither `key` nor `ros_parameter` is given, expected at least one of them"
        )
    if component.callback is None and kind is not ComponentKind.PUBLISHER:
        raise ObeliskConfigError(
            f"{place}: the {component} has no `callback`, expected {EXPECTED['callback']}"
        )
    return component


def _described(value: Any) -> str | ArgumentKind:
    if isinstance(value, str):
        return value
    if value is None:
        return ArgumentKind.NOTHING
    if isinstance(value, bool):
        return ArgumentKind.TRUTH_VALUE
    if isinstance(value, type | TypeVar):
        return ArgumentKind.CLASS
    if isinstance(value, Mapping):
        return ArgumentKind.MAPPING
    return ArgumentKind.FUNCTION if callable(value) else ArgumentKind.OTHER


def _is_message(value: Any) -> bool:
    return hasattr(value, "get_fields_and_field_types")


def _given(value: Any) -> str:
    if isinstance(value, type):
        return f"the class `{value.__name__}`"
    if _described(value) is ArgumentKind.FUNCTION:
        return f"the function `{getattr(value, '__qualname__', value)}`"
    return f"{_SHORT.repr(value)} ({with_article(type(value).__name__)})"


class ComponentTable(dict[str, T], Generic[T]):
    """Configured components by name, in any spelling.

    Iteration yields one name per component. Tests may replace a component with a mock.
    """

    def __init__(self, kind: ComponentKind) -> None:
        """Create an empty table for components of one kind."""
        super().__init__()
        self._kind = kind
        self._names: dict[str, str] = {}

    def __missing__(self, name: str) -> T:
        """Look up another spelling of a name.

        Raises:
            KeyError: no component has this name; the message lists the existing ones.
        """
        own = self._names.get(name)
        if own is None or not super().__contains__(own):
            existing = ", ".join(self) or "none (is the node configured?)"
            raise KeyError(f"no {self._kind.noun} `{name}`; existing: {existing}")
        return self[own]

    def __contains__(self, name: object) -> bool:
        return super().__contains__(name) or super().__contains__(self._names.get(str(name)))

    def get(self, name: str, default: Any = None) -> Any:
        """Return the component with this name, or the default."""
        try:
            return self[name]
        except KeyError:
            return default

    def add(self, name: str, names: frozenset[str], value: T) -> None:
        """Add a component under its own name and every other spelling."""
        self[name] = value
        self._names.update(dict.fromkeys({name, *names}, name))

    def forget(self) -> None:
        """Remove every component and every name."""
        self.clear()
        self._names.clear()
