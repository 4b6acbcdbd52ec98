from obelisk_control_msgs.msg import PositionSetpoint

from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class GrippingController(ArmController):
    """Commands an arm with one joint, and a gripper with two."""

    def __init__(self, node_name: str = "gripping_controller") -> None:
        super().__init__(node_name)
        self.register_obk_publisher("pub_gripper", PositionSetpoint)

    def compute_control(self) -> PositionSetpoint:
        gripper = PositionSetpoint()
        gripper.u_mujoco = [0.0, 0.0]
        self.obk_publishers["pub_gripper"].publish(gripper)
        return super().compute_control()


def main() -> None:
    spin_obelisk(None, GrippingController)
