"""The node of `docs/how-to/from-ros.md` behaves like the plain node next to it."""

import re
from pathlib import Path
from typing import Any

import pytest
import rclpy
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from rclpy.node import Node

pytestmark = pytest.mark.ros

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "from-ros.md"
PLAIN, OBELISK = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
SETTINGS = {
    "pub_ctrl_setting": "{topic: ctrl}",
    "sub_est_setting": "{topic: est}",
    "timer_ctrl_setting": "{timer_period_sec: 0.01}",
}


def test_both_nodes_send_the_same_commands() -> None:
    known: dict[str, Any] = {
        "Node": Node,
        "PositionSetpoint": PositionSetpoint,
        "EstimatedState": EstimatedState,
    }
    exec(PLAIN, known)
    plain_class = known["Balance"]
    exec(OBELISK, known)
    state = EstimatedState(q_joints=[0.5, 7.0])
    rclpy.init()
    try:
        plain = plain_class()
        sent: list[PositionSetpoint] = []
        plain.publisher.publish = sent.append
        plain.on_timer()
        plain.on_state(state)
        plain.on_timer()
        plain.destroy_node()

        class Configured(known["Balance"]):  # type: ignore[misc]
            """The node with the settings from a config."""

            def declare_parameter(self, name: str, value: Any, *more: Any, **words: Any) -> Any:
                return super().declare_parameter(name, SETTINGS.get(name, value), *more, **words)

        node = Configured()
        assert node.on_configure(None) is not None
        assert node.compute_control() is None
        node.update_x_hat(state)
        command = node.compute_control()
        node.destroy_node()
    finally:
        rclpy.shutdown()
    assert [list(message.u_mujoco) for message in sent] == [[-1.0]]
    assert list(command.u_mujoco) == [-1.0]
