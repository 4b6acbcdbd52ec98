"""Bind the arguments of `register_obk_*` in each of the three generations of the Python API.

Positional arguments (for subscriptions and timers, the second argument is the callback):

- G1, since 2024-07: `ros_parameter, key, msg_type, default`
- G2, since 2024-12: `ros_parameter, msg_type, key, default_config_str`
- G3, since 2026-05: `key, msg_type`

A class is the `msg_type`, and the string after it is the key. The first string is the ROS parameter
if the call also has a `key`, or if the string ends in `_setting`. Otherwise it is the key, and the
call is G3.

Unless the call sets `required`, a component with a ROS parameter is required (G1 and G2 raise an
error), and one with only a key is optional (G3 logs a warning and continues). The components of the
base classes are required if the constructor received no message type (G1), otherwise optional.

Values of any type can be bound: those of a running node, or expressions in its source.
"""

from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from types import MappingProxyType
from typing import Final, TypeVar

from obelisk_spec.components import SETTING_SUFFIX
from obelisk_spec.suggestions import did_you_mean

__all__ = [
    "EXPECTED",
    "ArgumentKind",
    "RegistrationArgumentError",
    "bind_registration",
    "is_expected",
    "is_required_by_default",
]

T = TypeVar("T")


class ArgumentKind(Enum):
    """The kind of an argument that is not a string."""

    CLASS = "class"
    FUNCTION = "function"
    MAPPING = "mapping"
    NOTHING = "None"
    TRUTH_VALUE = "truth value"
    OTHER = "value"
    UNKNOWN = "unknown"
    """An expression whose value is only known at runtime."""


_LEADING: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "register_obk_publisher": ("name",),
        "register_obk_subscription": ("name", "callback"),
        "register_obk_timer": ("name", "callback"),
    }
)
_KEY_FIRST: Final = ("key", "msg_type", "default")
_CLASS_FIRST: Final = ("msg_type", "key", "default")
_OF_TIMER: Final = ("key", "default")

_ALIASES: Final = MappingProxyType({"default_config_str": "default"})

EXPECTED: Final[Mapping[str, str]] = MappingProxyType(
    {
        "ros_parameter": "the name of a ROS parameter as a str",
        "key": "a str",
        "callback": "a function or method",
        "msg_type": "a message class",
        "default": "settings as a str or a dict",
        "required": "True or False",
    }
)
"""Argument -> its type, as text for messages."""

_KINDS: Final[Mapping[str, tuple[ArgumentKind, ...]]] = MappingProxyType(
    {
        "ros_parameter": (),
        "key": (),
        "callback": (ArgumentKind.FUNCTION,),
        "msg_type": (ArgumentKind.CLASS,),
        "default": (ArgumentKind.MAPPING,),
        "required": (ArgumentKind.TRUTH_VALUE,),
    }
)
_TEXTS: Final = ("ros_parameter", "key", "default")


class RegistrationArgumentError(ValueError):
    """The arguments match none of the three generations; the message gives the reason."""


def bind_registration(
    method: str,
    positional: Sequence[T],
    named: Mapping[str, T],
    describe: Callable[[T], str | ArgumentKind],
) -> dict[str, T]:
    """Map the arguments of a call of any generation to their names.

    Args:
        method: `register_obk_publisher`, `register_obk_subscription` or `register_obk_timer`.
        positional: the positional arguments, without `self`.
        named: the keyword arguments.
        describe: returns an argument's value if it is a string, otherwise its kind.

    Returns:
        Arguments by names in `EXPECTED`; types are not checked, see `is_expected`.

    Raises:
        RegistrationArgumentError: too many arguments, an unknown one, or one given twice.
    """
    order = _order(method, [describe(argument) for argument in positional])
    if len(positional) > len(order):
        raise RegistrationArgumentError(
            f"{len(positional)} positional arguments, expected at most {len(order)}: "
            f"{', '.join(order).replace('name', 'ros_parameter', 1)}"
        )
    bound = dict(zip(order, positional, strict=False))
    name = bound.pop("name", None)
    allowed = [key for key in EXPECTED if key in (*order, "ros_parameter", "required")]
    for written, argument in named.items():
        key = _ALIASES.get(written, written)
        if key not in allowed:
            hint = did_you_mean(written, allowed)
            raise RegistrationArgumentError(f"unexpected argument `{written}`; {hint}")
        if key in bound:
            raise RegistrationArgumentError(f"`{key}` is given twice")
        bound[key] = argument
    if name is None:
        return bound
    return _with_name(name, bound, describe)


def _order(method: str, kinds: Sequence[str | ArgumentKind]) -> tuple[str, ...]:
    leading = _LEADING[method]
    if method == "register_obk_timer":
        return (*leading, *_OF_TIMER)
    match kinds[len(leading) :]:
        case [ArgumentKind.CLASS, *_]:
            return (*leading, *_CLASS_FIRST)
        case [ArgumentKind.NOTHING | ArgumentKind.UNKNOWN, str(), *_]:
            return (*leading, *_CLASS_FIRST)
        case [ArgumentKind.UNKNOWN]:
            # A key is almost always a literal; a class is often an argument of the constructor.
            return (*leading, *_CLASS_FIRST)
    return (*leading, *_KEY_FIRST)


def _with_name(
    name: T, bound: dict[str, T], describe: Callable[[T], str | ArgumentKind]
) -> dict[str, T]:
    """Add the first positional argument, as the ROS parameter or as the key."""
    if "ros_parameter" in bound:
        if "key" in bound:
            raise RegistrationArgumentError("`ros_parameter` is given twice")
        return {**bound, "key": name}
    text = describe(name)
    # In G3, this argument is the key, so a call that also has a `key` is older, even if None.
    names_parameter = "key" in bound or (isinstance(text, str) and text.endswith(SETTING_SUFFIX))
    return {**bound, "ros_parameter" if names_parameter else "key": name}


def is_expected(argument: str, described: str | ArgumentKind) -> bool:
    """Whether an argument of a registration has an allowed type."""
    if isinstance(described, str):
        return argument in _TEXTS
    if described in (ArgumentKind.NOTHING, ArgumentKind.UNKNOWN):
        return True
    return described in _KINDS[argument]


def is_required_by_default(ros_parameter: str | None) -> bool:
    """Whether a registration without `required` fails if it has no settings.

    Args:
        ros_parameter: the ROS parameter in the call; None if it has only a key (G3).
    """
    return ros_parameter is not None
