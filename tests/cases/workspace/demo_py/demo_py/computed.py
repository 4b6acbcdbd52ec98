from obelisk_sensor_msgs.msg import JointEncoders

from demo_py.estimator import ArmEstimator
from obelisk_py.core.utils.ros import spin_obelisk


class Computed(ArmEstimator):
    """Registers components named by parameters, which static analysis cannot know."""

    def __init__(self, node_name: str = "computed") -> None:
        super().__init__(node_name)
        for index in range(2):
            name = f"sub_leg_{index}"
            self.register_obk_subscription(
                f"{name}_setting", self.on_joints, key=name, msg_type=JointEncoders, required=False
            )
            self.declare_parameter(f"gain_{index}", 1.0)


def main() -> None:
    spin_obelisk(None, Computed)
