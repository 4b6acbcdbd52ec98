"""The keys of the language, by the mapping that they stand in. Data only.

The JSON schema is tested against these tables.
"""

from collections.abc import Mapping
from typing import Final

__all__ = [
    "COMPONENT_KEYS",
    "JOYSTICK_KEYS",
    "NODE_KEYS",
    "NO_EFFECT_KEYS",
    "OBK_KEYS",
    "OLDER_KEYS",
    "QOS_KEYS",
    "RAY_CASTER_KEYS",
    "RESERVED_KEYS",
    "ROBOT_KEYS",
    "SECTION_KEYS",
    "SENSOR_GROUP_KEYS",
    "SIM_KEYS",
    "TIMER_KEYS",
    "VIZ_KEYS",
    "VIZ_NODE_KEYS",
]

SECTION_KEYS: Final = ("control", "estimation", "robot", "sensing", "viz", "joystick")
RESERVED_KEYS: Final = ("config", "include", *SECTION_KEYS, "vars", "version", "obk")

NODE_KEYS: Final = (
    "pkg",
    "executable",
    "name",
    "namespace",
    "params_path",
    "params",
    "callback_groups",
    "publishers",
    "subscribers",
    "timers",
    "remappings",
    "log_level",
    "env",
    "respawn",
    "on_crash",
    "device",
    "impl",
)
ROBOT_KEYS: Final = (*NODE_KEYS, "is_simulated", "sim")
VIZ_NODE_KEYS: Final = (*NODE_KEYS, "robot_pkg", "urdf", "robot_topic", "tf_prefix")

COMPONENT_KEYS: Final = (
    "ros_parameter",
    "key",
    "topic",
    "msg_type",
    "history_depth",
    "qos",
    "callback_group",
    "max_age_sec",
    "stale_action",
    "callback_key",
    "non_obelisk",
)
TIMER_KEYS: Final = (
    "ros_parameter",
    "key",
    "timer_period_sec",
    "callback_group",
    "callback_key",
    "non_obelisk",
)
QOS_KEYS: Final = ("reliability", "durability", "history_depth")

SIM_KEYS: Final = (
    "ros_parameter",
    "model_xml_path",
    "robot_pkg",
    "num_steps_per_viz",
    "n_u",
    "time_step",
    "sensor_settings",
    "viz_geoms",
)
SENSOR_GROUP_KEYS: Final = (
    "topic",
    "dt",
    "msg_type",
    "history_depth",
    "sensor_names",
    "scan_config",
    "config_path",
    "noise",
    "dropout",
    "delay",
    "seed",
)
VIZ_KEYS: Final = ("on", "rviz_pkg", "rviz_config", "viz_nodes")
JOYSTICK_KEYS: Final = (
    "on",
    "pub_topic",
    "sub_topic",
    "device_id",
    "device_name",
    "deadzone",
    "autorepeat_rate",
    "sticky_buttons",
    "coalesce_interval_ms",
)
OBK_KEYS: Final = ("ignore",)
RAY_CASTER_KEYS: Final = ("site_name", "geom_groups", "pattern", "scan_config", "max_distance")

OLDER_KEYS: Final[Mapping[str, str]] = {"sensor_type": "msg_type"}
"""Older name of a sensor group's key -> the newer one."""
NO_EFFECT_KEYS: Final = ("non_obelisk", "callback_key", "impl")
"""Keys of older configs that are read and do nothing."""
