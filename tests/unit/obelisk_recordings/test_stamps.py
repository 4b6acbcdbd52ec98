"""Stamps of headers in messages, wherever they are."""

from pathlib import Path
from typing import Any

from mcap_ros2.writer import Writer

from obelisk_recordings.chunks import messages_in_order
from obelisk_recordings.clock import with_earlier_stamps
from obelisk_recordings.layout import parse_definition

BAR = "=" * 80
TREE = f"""\
string name
demo_msgs/Pose[] poses
std_msgs/Header[2] others
demo_msgs/Pose pose
builtin_interfaces/Time due
{BAR}
MSG: demo_msgs/Pose
uint8 id
std_msgs/Header header
float64 x
{BAR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{BAR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def header(seconds: int, nanoseconds: int = 7) -> dict[str, Any]:
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": "base" * seconds}


def tree(shift_s: int) -> dict[str, Any]:
    def shifted(seconds: int, nanoseconds: int = 7) -> dict[str, Any]:
        stamp = {"sec": seconds - shift_s, "nanosec": nanoseconds}
        return {**header(seconds), "stamp": stamp}

    poses = [{"id": number, "header": shifted(3 + number), "x": 0.5} for number in range(3)]
    pose = {"id": 9, "header": shifted(4), "x": 1.5}
    others = [shifted(2), header(0, 0)]  # the second one is not set
    return {
        "name": "tree",
        "poses": poses,
        "others": others,
        "pose": pose,
        "due": {"sec": 8, "nanosec": 0},
    }


def test_the_stamps_of_all_headers_become_earlier_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("demo_msgs/msg/Tree", TREE)
        for time_ns, message in enumerate((tree(0), tree(2)), start=1):
            writer.write_message("/tree", schema, message, time_ns, time_ns)
        writer.finish()
    recorded, expected = (one.data for one in messages_in_order(path, ["/tree"]))
    definition = parse_definition("demo_msgs/msg/Tree", TREE)
    assert with_earlier_stamps(recorded, definition, 2_000_000_000) == expected
