"""Message packages without their generator, until it is needed."""

import subprocess
import sys

CODE = """
import sys
from obk_cli.ros.participant import defer_message_generator
defer_message_generator()
from obelisk_control_msgs.msg import PositionSetpoint
PositionSetpoint.__import_type_support__()
assert PositionSetpoint._TYPE_SUPPORT is not None
assert not {"lark", "rosidl_generator_py.generate_py_impl"} & sys.modules.keys()
from rosidl_generator_py import generate_py
assert generate_py is sys.modules["rosidl_generator_py.generate_py_impl"].generate_py
import rosidl_generator_py
assert not hasattr(rosidl_generator_py, "other")
"""


def test_messages_load_their_generator_only_when_needed() -> None:
    subprocess.run([sys.executable, "-c", CODE], check=True, timeout=60)
