"""Register the components of a node (publisher, subscription, timer), and look them up by name.

The node's constructor registers them; configure creates their ROS handles.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Generic, TypeVar

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_spec.components import component_spellings

__all__ = ["ComponentKind", "ComponentTable", "RegisteredComponent", "spellings"]

T = TypeVar("T")


class ComponentKind(Enum):
    """The three kinds of components; the value is their list's name in `obelisk_settings`."""

    PUBLISHER = "publishers"
    SUBSCRIPTION = "subscribers"
    TIMER = "timers"

    @property
    def noun(self) -> str:
        """The kind as a word of a message."""
        return self.name.lower()


def spellings(*names: str | None) -> frozenset[str]:
    """Every spelling of every name that is given."""
    return frozenset(s for name in names if name for s in component_spellings(name))


@dataclass(frozen=True, slots=True, kw_only=True)
class RegisteredComponent:
    """A component as the code registers it, before any setting is known."""

    kind: ComponentKind
    ros_parameter: str | None
    key: str | None
    callback: Callable[..., Any] | None = None
    msg_type: type[Any] | None = None
    default: str | Mapping[str, Any] | None = None
    required: bool = True

    def __post_init__(self) -> None:
        if not self.ros_parameter and not self.key:
            raise ObeliskConfigError(
                f"a {self.kind.noun} was registered with neither ros_parameter nor key"
            )
        if self.callback is None and self.kind is not ComponentKind.PUBLISHER:
            raise ObeliskConfigError(f"the {self} was registered without a callback")

    def __str__(self) -> str:
        return f"{self.kind.noun} `{self.key or self.ros_parameter}`"

    @property
    def names(self) -> frozenset[str]:
        """Every name under which the component is known, in all spellings."""
        return spellings(self.ros_parameter, self.key)


class ComponentTable(Mapping[str, T], Generic[T]):
    """Configured components by name; every spelling of a name finds its component.

    Iterating gives one name a component.
    """

    def __init__(self, kind: ComponentKind) -> None:
        """Make an empty table for components of one kind."""
        self._kind = kind
        self._values: dict[str, T] = {}
        self._names: dict[str, str] = {}

    def __getitem__(self, name: str) -> T:
        """The component of that name.

        Raises:
            KeyError: there is none; the message lists those that exist.
        """
        try:
            return self._values[self._names[name]]
        except KeyError:
            have = ", ".join(self._values) or "none (is the node configured?)"
            raise KeyError(f"no {self._kind.noun} `{name}`; there are: {have}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def add(self, name: str, names: frozenset[str], value: T) -> None:
        """Add a component under its own name and every other spelling."""
        self._values[name] = value
        self._names.update(dict.fromkeys({name, *names}, name))

    def clear(self) -> None:
        """Forget every component."""
        self._values.clear()
        self._names.clear()
