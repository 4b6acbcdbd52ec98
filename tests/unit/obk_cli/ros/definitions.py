"""Message types without ROS: fields with the names in generated packages, and a message."""

from collections.abc import Mapping
from typing import Any

FIELDS: Mapping[str, Mapping[str, str]] = {
    "std_msgs/Header": {"stamp": "builtin_interfaces/Time", "frame_id": "string"},
    "builtin_interfaces/Time": {"sec": "int32", "nanosec": "uint32"},
    "pkg/Point": {"x": "double", "y": "float"},
    "pkg/State": {
        "header": "std_msgs/Header",
        "q_joints": "sequence<double>",
        "gains": "double[3]",
        "few": "sequence<int8, 2>",
        "corners": "sequence<pkg/Point>",
        "name": "string<5>",
        "is_on": "boolean",
        "count": "uint8",
        "mark": "octet",
    },
    "pkg/Empty": {},
}


def fields_of(name: str) -> Mapping[str, str]:
    return FIELDS[name]


class Message:
    """A fake message of a generated package."""

    def __init__(self, **fields: Any) -> None:
        self._fields = fields

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self._fields[name]
        except KeyError:
            raise AttributeError(name) from None

    def get_fields_and_field_types(self) -> Mapping[str, str]:
        return dict.fromkeys(self._fields, "")
