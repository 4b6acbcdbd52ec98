from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import JointEncoders, ObkImu
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from demo_py.controller import ArmController
from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.utils.ros import spin_obelisk


class SecondEstimator(ObeliskEstimator):
    """Registers in the API of 2024-12 to 2026-05: the message type before the key."""

    def __init__(self, node_name: str = "second_estimator") -> None:
        super().__init__(node_name, EstimatedState)
        self.register_obk_subscription(
            "sub_sensor_setting", self.on_joints, JointEncoders, "sub_sensor"
        )
        self.register_obk_subscription(
            "sub_imu_setting", self.on_imu, ObkImu, key="sub_imu", default_config_str="topic:/imu"
        )

    def on_joints(self, msg: JointEncoders) -> None:
        self.joints = msg.y

    def on_imu(self, msg: ObkImu) -> None:
        self.imu = msg

    def compute_state_estimate(self) -> EstimatedState:
        msg = EstimatedState(q_joints=self.joints)
        self.obk_publishers["pub_est"].publish(msg)
        return msg


class ThirdEstimator(SecondEstimator):
    """Registers in the API since 2026-05, and in `on_configure`: keys, and no ROS parameters."""

    def __init__(self, node_name: str = "third_estimator") -> None:
        ObeliskEstimator.__init__(self, node_name, EstimatedState)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.register_obk_subscription("sub_sensor", self.on_joints, JointEncoders)
        self.register_obk_subscription("sub_imu", self.on_imu, ObkImu)
        return super().on_configure(state)


class ThirdController(ArmController):
    """Registers through its own method."""

    def __init__(self, node_name: str = "third_controller") -> None:
        super().__init__(node_name)
        self.add("pub_debug", "timer_debug")

    def add(self, publisher: str, timer: str) -> None:
        self.register_obk_publisher(publisher, PositionSetpoint)
        self.register_obk_timer(timer, self.debug)

    def debug(self) -> None:
        self.obk_publishers["pub_debug"].publish(PositionSetpoint(u_mujoco=[0.0]))


def second() -> None:
    spin_obelisk(None, SecondEstimator)


def third() -> None:
    spin_obelisk(None, ThirdEstimator)


def controller() -> None:
    spin_obelisk(None, ThirdController)
