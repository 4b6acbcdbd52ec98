"""Sections and components of a config, and which names mean the same component.

The ROS parameter `pub_ctrl_setting` and the key `pub_ctrl` name one component; the seeds also
write `publisher_ctrl`.
"""

from typing import Final

__all__ = [
    "CALLBACK_GROUP_TYPES",
    "CONTROL_SUBSCRIPTION",
    "DEFAULT_HISTORY_DEPTH",
    "DEFAULT_STALE_ACTION",
    "SETTING_SUFFIX",
    "STALE_ACTIONS",
    "STANDARD_COMPONENTS",
    "TIERS",
    "component_identity",
    "component_spellings",
    "standard_component",
]

TIERS: Final = ("robot", "sensing", "estimation", "control", "viz", "joystick")
"""Sections that hold nodes, in bring-up order: publishers activate before their subscribers."""

SETTING_SUFFIX: Final = "_setting"
DEFAULT_HISTORY_DEPTH: Final = 10

CALLBACK_GROUP_TYPES: Final = ("MutuallyExclusiveCallbackGroup", "ReentrantCallbackGroup")

CONTROL_SUBSCRIPTION: Final = "sub_ctrl"
"""The component by which a robot gets its commands; the one that `max_age_sec` belongs to."""

STALE_ACTIONS: Final = ("zero", "hold", "damp")
"""What a robot does once its newest command is too old."""
DEFAULT_STALE_ACTION: Final = "zero"

STANDARD_COMPONENTS: Final = (
    "pub_ctrl",
    "sub_est",
    "timer_ctrl",
    "pub_est",
    "timer_est",
    "sub_ctrl",
    "pub_true_sim_state",
    "timer_true_sim_state",
)
"""Keys of the components that the base classes register."""

_LONG_PREFIXES: Final = (("pub_", "publisher_"), ("sub_", "subscriber_"))


def component_identity(name: str) -> str:
    """The component that a `ros_parameter` or `key` names: `pub_ctrl_setting` -> `pub_ctrl`."""
    return name.removesuffix(SETTING_SUFFIX)


def component_spellings(name: str) -> tuple[str, ...]:
    """Every name under which a component is found, the plain key first.

    `pub_ctrl_setting` -> `pub_ctrl`, `pub_ctrl_setting`, `publisher_ctrl`,
    `publisher_ctrl_setting`; a name that starts otherwise has two.
    """
    key = component_identity(name)
    keys = [key]
    for short, long in _LONG_PREFIXES:
        if key.startswith(short):
            keys.append(long + key.removeprefix(short))
        elif key.startswith(long):
            keys.append(short + key.removeprefix(long))
    return tuple(spelling for k in keys for spelling in (k, k + SETTING_SUFFIX))


def standard_component(name: str) -> str | None:
    """The base class component that `name` means in any spelling, None for the user's own."""
    return next((key for key in STANDARD_COMPONENTS if name in component_spellings(key)), None)
