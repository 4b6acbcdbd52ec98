"""Messages received over DDS have MuJoCo's values in the same state, for all kinds of sensors."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from numpy.typing import ArrayLike
from obelisk_sensor_msgs.msg import (
    JointEncoders,
    ObkForceSensor,
    ObkFramePose,
    ObkImu,
    ObkJointEncoders,
    ObkScan,
    TrueSimState,
)
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, Imu, PointCloud2
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

from obelisk_py.core.sim.mujoco import ObeliskMujocoRobot
from obelisk_py.core.sim.mujoco.raycast import lay_out, typed_ray_caster
from obelisk_spec.components import format_setting

from .stack import eventually, parameters, request, spinning

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

MODEL = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 0.1"/>
    <geom name="shelf" type="box" pos="2 0.3 0.5" size="0.1 2 0.5"/>
    <body name="base" pos="0 0 0.9" euler="0.1 0.2 0.3">
      <freejoint name="root"/>
      <geom name="trunk" type="ellipsoid" size="0.2 0.1 0.05"/>
      <site name="imu" pos="0.03 0.01 0.02" euler="0.4 -0.2 1.1"/>
      <body name="arm" pos="0 0.2 0">
        <joint name="elbow" axis="0 1 0"/>
        <geom name="rod" type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03"/>
        <site name="hand" pos="0 0 -0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="elbow"/></actuator>
  <sensor>
    <jointpos name="q" joint="elbow"/>
    <jointvel name="v" joint="elbow"/>
    <accelerometer name="acc" site="imu"/>
    <gyro name="gyro" site="imu"/>
    <framequat name="turn" objtype="site" objname="imu"/>
    <framepos name="at" objtype="site" objname="imu"/>
    <velocimeter name="speed" site="imu"/>
    <force name="pull" site="hand"/>
  </sensor>
  <keyframe>
    <key name="ic" qpos="0 0 0.9 0.9 0.1 0.3 0.2 0.4" qvel="0.1 0.2 0.3 1 -2 3 1.5" ctrl="0.2"/>
  </keyframe>
</mujoco>
"""
IMU = {"acc": "accelerometer", "gyro": "gyro", "turn": "framequat"}
POSE = {"at": "framepos", "turn": "framequat"}
LIDAR = {
    "type": "lidar_scan",
    "channels": 3,
    "vertical_fov_range": [-60.0, 0.0],
    "horizontal_fov_range": [-30.0, 30.0],
    "horizontal_res": 15.0,
}
SENSORS: dict[str, tuple[type[Any], dict[str, str]]] = {
    "ObkJointEncoders": (ObkJointEncoders, {"q": "jointpos", "v": "jointvel"}),
    "JointEncoders": (JointEncoders, {"q": "jointpos", "v": "jointvel"}),
    "ObkImu": (ObkImu, IMU),
    "Imu": (Imu, IMU),
    "ObkFramePose": (ObkFramePose, POSE),
    "PoseStamped": (PoseStamped, POSE),
    "Odometry": (Odometry, {**POSE, "speed": "velocimeter", "gyro": "gyro"}),
    "ObkForceSensor": (ObkForceSensor, {"pull": "force"}),
}
SCANS: dict[str, type[Any]] = {"ObkScan": ObkScan, "PointCloud2": PointCloud2, "DepthImage": Image}
STEPS = 5


@pytest.fixture
def got(
    tmp_path: Any, ros_domain: int
) -> Iterator[tuple[ObeliskMujocoRobot, dict[str, list[Any]]]]:
    """A simulator that stops after a few steps, and the messages of each kind."""
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    groups = [
        {"topic": f"/{kind}", "dt": 0.002, "msg_type": kind, "sensor_names": names}
        for kind, (_, names) in SENSORS.items()
    ]
    groups += [
        {
            "topic": f"/{kind}",
            "dt": 0.002,
            "msg_type": kind,
            "scan_config": {"site_name": "imu", "pattern": LIDAR, "frame": "world"},
        }
        for kind in SCANS
    ]
    settings = parameters(
        mujoco_setting=format_setting(
            {
                "model_xml_path": str(path),
                "sensor_settings": groups,
                "viz_geoms": {"dt": 0.002, "shelf": "box", "rod": "capsule"},
            }
        ),
        sub_ctrl_setting="{topic: /ctrl, msg_type: PositionSetpoint}",
        pub_true_sim_state_setting="{topic: /TrueSimState}",
        timer_true_sim_state_setting="{timer_period_sec: 0.01}",
        use_sim_time=True,
    )
    with spinning(lambda: ObeliskMujocoRobot("sim", **settings)) as node:
        kinds: dict[str, type[Any]] = {kind: message for kind, (message, _) in SENSORS.items()}
        kinds |= {**SCANS, "TrueSimState": TrueSimState, "sim/viz_geoms": MarkerArray}
        received: dict[str, list[Any]] = {kind: [] for kind in kinds}
        for kind, message in kinds.items():
            node.create_subscription(
                message, f"/{kind}", received[kind].append, QoSProfile(depth=100)
            )
        yield node, received


def _stamp_ns(message: Any) -> int:
    stamp = message.markers[0].header.stamp if hasattr(message, "markers") else message.header.stamp
    return int(stamp.sec * 1_000_000_000 + stamp.nanosec)


def _call(node: Any, kind: type[Any], name: str, **fields: Any) -> None:
    client = node.create_client(kind, f"~/{name}")
    eventually(client.service_is_ready, f"the service {name}")
    answer = client.call_async(kind.Request(**fields))
    eventually(answer.done, f"the answer of {name}")
    assert answer.result().success


def _near(numbers: ArrayLike, wanted: ArrayLike, tolerance: float = 1e-12) -> None:
    numbers, wanted = np.asarray(numbers), np.asarray(wanted)
    assert numbers.shape == wanted.shape
    assert np.nanmax(np.abs(wanted)) > 1e-3, "nothing moves"
    assert np.allclose(numbers, wanted, rtol=tolerance, atol=tolerance, equal_nan=True)


def _xyz(field: Any) -> list[float]:
    return [field.x, field.y, field.z]


def _wxyz(field: Any) -> list[float]:
    return [field.w, field.x, field.y, field.z]


def test_received_messages_have_the_values_of_mujoco(
    got: tuple[ObeliskMujocoRobot, dict[str, list[Any]]],
) -> None:
    node, received = got
    assert request(node, "configure")
    assert request(node, "activate")
    eventually(lambda: all(received[kind] for kind in (*SENSORS, *SCANS)), "each kind")
    _call(node, SetBool, "pause", data=True)
    for _ in range(STEPS):
        _call(node, Trigger, "step")
    simulation = node._simulation
    assert simulation is not None
    node.publish_true_sim_state()
    for kind, messages in received.items():
        eventually(
            lambda messages=messages: messages and _stamp_ns(messages[-1]) == simulation.time_ns,
            f"{kind} of the last step",
        )
    newest = {kind: messages[-1] for kind, messages in received.items()}
    _assert_sensors(newest, simulation.data)
    _assert_rays(newest, simulation.model, simulation.data)
    _assert_rest(newest, simulation.data)


def _assert_sensors(newest: dict[str, Any], data: mujoco.MjData) -> None:
    value = {
        name: data.sensor(name).data
        for name in ("q", "v", "acc", "gyro", "turn", "at", "speed", "pull")
    }
    _near(newest["ObkJointEncoders"].joint_pos, value["q"])
    _near(newest["ObkJointEncoders"].joint_vel, value["v"])
    _near(newest["JointEncoders"].y, [*value["q"], *value["v"]])
    for kind in ("ObkImu", "Imu"):
        _near(_xyz(newest[kind].linear_acceleration), value["acc"])
        _near(_xyz(newest[kind].angular_velocity), value["gyro"])
        _near(_wxyz(newest[kind].orientation), value["turn"])
    twist = newest["Odometry"].twist.twist
    _near(_xyz(twist.linear), value["speed"])
    _near(_xyz(twist.angular), value["gyro"])
    for pose in (
        newest["ObkFramePose"],
        newest["PoseStamped"].pose,
        newest["Odometry"].pose.pose,
    ):
        _near(_xyz(pose.position), value["at"])
        _near(_wxyz(pose.orientation), value["turn"])
    _near(newest["ObkForceSensor"].forces, value["pull"])


def _assert_rays(newest: dict[str, Any], model: mujoco.MjModel, data: mujoco.MjData) -> None:
    layout = lay_out(typed_ray_caster({"site_name": "imu", "pattern": LIDAR}).pattern)
    site = data.site("imu")
    directions = layout.directions @ site.xmat.reshape(3, 3).T
    body = model.body("base").id
    groups = np.array([1, 0, 0, 0, 0, 0], np.uint8)
    distances = np.array(
        [
            mujoco.mj_ray(model, data, site.xpos, direction, groups, 1, body, None)
            for direction in directions
        ]
    )
    distances[distances < 0] = np.nan
    is_hit = np.isfinite(distances)
    assert is_hit.any()
    image, cloud = (
        np.frombuffer(newest[kind].data, np.float32) for kind in ("DepthImage", "PointCloud2")
    )
    for numbers in (newest["ObkScan"].data, image):
        _near(np.asarray(numbers), distances, tolerance=1e-6)
    points = distances[is_hit, None] * layout.directions[is_hit]
    _near(cloud.reshape(-1, 4)[:, :3], points, tolerance=1e-6)


def _assert_rest(newest: dict[str, Any], data: mujoco.MjData) -> None:
    state = newest["TrueSimState"]
    _near(state.y, [*data.qpos, *data.qvel])
    _near(state.q_base, data.qpos[[0, 1, 2, 4, 5, 6, 3]])
    _near(state.v_base, data.qvel[:6])
    _near([*state.q_joints, *state.v_joints], [data.qpos[7], data.qvel[6]])
    shelf, rod, *_ = newest["sim/viz_geoms"].markers
    for marker, geom in ((shelf, "shelf"), (rod, "rod")):
        _near(_xyz(marker.pose.position), data.geom(geom).xpos)
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, np.array(_wxyz(marker.pose.orientation)))
        _near(rotation, data.geom(geom).xmat)


@pytest.mark.slow
def test_after_an_hour_stamps_and_clock_are_exact(
    got: tuple[ObeliskMujocoRobot, dict[str, list[Any]]],
) -> None:
    node, received = got
    clock: list[Clock] = []
    node.create_subscription(Clock, "/clock", clock.append, QoSProfile(depth=100))
    assert request(node, "configure")
    assert request(node, "activate")
    eventually(lambda: clock, "the clock")
    _call(node, SetBool, "pause", data=True)
    simulation = node._simulation
    assert simulation is not None
    simulation.steps = 1_800_000 - 1
    _call(node, Trigger, "step")
    eventually(lambda: (clock[-1].clock.sec, clock[-1].clock.nanosec) == (3600, 0), "an hour")
    imu = received["ObkImu"]
    eventually(lambda: imu and _stamp_ns(imu[-1]) == 3_600_000_000_000, "the IMU of that step")
    _call(node, Trigger, "reset")
    _call(node, Trigger, "step")
    eventually(lambda: (clock[-1].clock.sec, clock[-1].clock.nanosec) == (0, 2_000_000), "a start")
