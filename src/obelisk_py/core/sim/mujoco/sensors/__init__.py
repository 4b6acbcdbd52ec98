"""Sensor groups: convert MuJoCo's sensors to messages, with one module per kind.

`SENSOR_KINDS` maps the `msg_type` of a group to the builder of its sampler. To add a kind, add a
module with a builder and a line in this table.
"""

from collections.abc import Mapping
from types import MappingProxyType

from obelisk_py.core.sim.mujoco.sensors.image import OBK_IMAGE
from obelisk_py.core.sim.mujoco.sensors.imu_and_force import FORCE, IMU, OBK_IMU
from obelisk_py.core.sim.mujoco.sensors.joint_encoders import JOINT_ENCODERS, OBK_JOINT_ENCODERS
from obelisk_py.core.sim.mujoco.sensors.kind import Sampler, SensorKind, SensorSource
from obelisk_py.core.sim.mujoco.sensors.pose import FRAME_POSE, ODOMETRY, POSE_STAMPED
from obelisk_py.core.sim.mujoco.sensors.raycast import DEPTH_IMAGE, OBK_SCAN, POINT_CLOUD

__all__ = ["SENSOR_KINDS", "Sampler", "SensorKind", "SensorSource"]

SENSOR_KINDS: Mapping[str, SensorKind] = MappingProxyType(
    {
        "ObkJointEncoders": OBK_JOINT_ENCODERS,
        "JointEncoders": JOINT_ENCODERS,
        "ObkImu": OBK_IMU,
        "Imu": IMU,
        "ObkFramePose": FRAME_POSE,
        "PoseStamped": POSE_STAMPED,
        "Odometry": ODOMETRY,
        "ObkForceSensor": FORCE,
        "ObkImage": OBK_IMAGE,
        "ObkScan": OBK_SCAN,
        "PointCloud2": POINT_CLOUD,
        "DepthImage": DEPTH_IMAGE,
    }
)
"""Bare `msg_type` of a sensor group -> its kind."""
