"""The estimator node: computes the state of trunk and joints from encoders, IMU and feet."""

import numpy as np
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import ObkForceSensor, ObkImu, ObkJointEncoders
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.time import Time

from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.utils.ros import spin_obelisk
from quadruped_py.odometry import Odometry, Reading, rotation_matrix

__all__ = ["QuadrupedEstimator", "main"]


class QuadrupedEstimator(ObeliskEstimator):
    """Estimates the orientation from the IMU, and position and velocity from the legs."""

    encoders: ObkJointEncoders | None = None
    imu: ObkImu | None = None
    feet: ObkForceSensor | None = None
    read_at: Time | None = None
    """The stamp of the encoder reading behind the last estimate."""

    def __init__(self, node_name: str = "quadruped_estimator") -> None:
        """Create the node; its topics and rates come from the config."""
        super().__init__(node_name, est_msg_type=EstimatedState)
        self.register_obk_subscription(
            "sub_encoders_setting",
            self.encoders_callback,
            key="sub_encoders",
            msg_type=ObkJointEncoders,
        )
        self.register_obk_subscription(
            "sub_imu_setting", self.imu_callback, key="sub_imu", msg_type=ObkImu
        )
        self.register_obk_subscription(
            "sub_feet_setting", self.feet_callback, key="sub_feet", msg_type=ObkForceSensor
        )

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start from the pose of the keyframe."""
        self.encoders = self.imu = self.feet = self.read_at = None
        self.odometry = Odometry.at_start()
        return super().on_activate(state)

    def encoders_callback(self, msg: ObkJointEncoders) -> None:
        """Store the latest reading of the encoders."""
        self.encoders = msg

    def imu_callback(self, msg: ObkImu) -> None:
        """Store the latest reading of the IMU."""
        self.imu = msg

    def feet_callback(self, msg: ObkForceSensor) -> None:
        """Store the latest forces on the feet."""
        self.feet = msg

    def compute_state_estimate(self) -> EstimatedState | None:
        """Publish the estimate after each sensor has published a reading."""
        if self.encoders is None or self.imu is None or self.feet is None:
            return None
        turned, turning = self.imu.orientation, self.imu.angular_velocity
        quaternion = np.array([turned.x, turned.y, turned.z, turned.w])
        reading = Reading(
            angles=np.reshape(self.encoders.joint_pos, (4, 3)),
            speeds=np.reshape(self.encoders.joint_vel, (4, 3)),
            rotation=rotation_matrix(quaternion),
            turning=np.array([turning.x, turning.y, turning.z]),
            forces=np.array(self.feet.forces),
        )
        self.odometry.update(reading, self.period_s(Time.from_msg(self.encoders.stamp)))
        msg = EstimatedState(base_link_name="trunk", joint_names=self.encoders.joint_names)
        msg.header.stamp = self.encoders.stamp
        msg.header.frame_id = "world"
        msg.q_base = [*self.odometry.position, *quaternion]
        # Linear in the world, angular in the frame of the trunk.
        msg.v_base = [*self.odometry.velocity, *reading.turning]
        msg.q_joints = self.encoders.joint_pos
        msg.v_joints = self.encoders.joint_vel
        self.obk_publishers["pub_est"].publish(msg)
        return msg

    def period_s(self, read_at: Time) -> float:
        """The time since the previous encoder reading [s]."""
        last, self.read_at = self.read_at or read_at, read_at
        return float((read_at - last).nanoseconds * 1e-9)


def main(args: list[str] | None = None) -> None:
    """Run the node until it is stopped."""
    spin_obelisk(args, QuadrupedEstimator)
