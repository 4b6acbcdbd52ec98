"""All kinds of sensor groups have MuJoCo's values in the right fields, frames and names."""

import mujoco
import numpy as np
import pytest

from obelisk_py.core.messages import message_name
from obelisk_py.core.sim.mujoco.sensors import SENSOR_KINDS
from obelisk_spec.sensors import SENSOR_GROUPS

from .groups import STAMP, group, taken

pytestmark = pytest.mark.mujoco


def _sample(model, data, kind, names, warnings=None):
    warn = (warnings if warnings is not None else []).append
    return taken(kind, group(model, data, kind, names=names, warn=warn))


def _wxyz(field):
    return [field.w, field.x, field.y, field.z]


def _xyz(field):
    return [field.x, field.y, field.z]


def _same(numbers, data, *sensors):
    wanted = np.concatenate([data.sensor(name).data for name in sensors])
    assert len(numbers) == len(wanted)
    assert np.abs(np.asarray(numbers) - wanted).max() <= 1e-12
    assert np.abs(wanted).min() > 1e-6, "a zero would compare equal to nothing"


@pytest.mark.parametrize("kind", SENSOR_KINDS)
def test_a_kind_publishes_the_type_of_the_language(kind):
    assert message_name(SENSOR_KINDS[kind].message_type) == SENSOR_GROUPS[kind].published


def test_joint_encoders_stand_in_the_order_of_the_config(everything, moving):
    names = {
        "right_hip_pos": "jointpos",
        "left_hip_vel": "jointvel",
        "left_hip_pos": "jointpos",
        "right_hip_vel": "jointvel",
    }
    message = _sample(everything, moving, "ObkJointEncoders", names)
    assert message.joint_names == ["right_hip", "left_hip"]
    assert message.stamp == STAMP
    assert message.header.frame_id == "world"
    _same(message.joint_pos, moving, "right_hip_pos", "left_hip_pos")
    _same(message.joint_vel, moving, "right_hip_vel", "left_hip_vel")


def test_joint_encoders_without_velocity_sensors_have_none(everything, moving):
    message = _sample(everything, moving, "ObkJointEncoders", {"left_slide_pos": "jointpos"})
    assert message.joint_names == ["left_slide"]
    _same(message.joint_pos, moving, "left_slide_pos")
    assert len(message.joint_vel) == 0


def test_a_joint_that_lacks_one_of_the_sensors_is_filled_from_the_state(everything, moving):
    names = {"right_hip_pos": "jointpos", "left_hip_pos": "jointpos", "left_hip_vel": "jointvel"}
    message = _sample(everything, moving, "ObkJointEncoders", names)
    assert message.joint_names == ["right_hip", "left_hip"]
    _same(message.joint_vel, moving, "right_hip_vel", "left_hip_vel")


def test_plain_joint_encoders_are_positions_then_velocities(everything, moving):
    names = {
        "left_slide_vel": "jointvel",
        "right_hip_pos": "jointpos",
        "left_hip_vel": "jointvel",
        "left_slide_pos": "jointpos",
    }
    message = _sample(everything, moving, "JointEncoders", names)
    _same(message.y, moving, "right_hip_pos", "left_slide_pos", "left_slide_vel", "left_hip_vel")


@pytest.mark.parametrize("kind", ["ObkImu", "Imu"])
def test_an_imu_reports_in_the_frame_of_its_site(everything, moving, kind):
    names = {"imu_quat": "framequat", "acc": "accelerometer", "gyro": "gyro"}
    message = _sample(everything, moving, kind, names)
    assert message.header.frame_id == "imu"
    _same(_xyz(message.linear_acceleration), moving, "acc")
    _same(_xyz(message.angular_velocity), moving, "gyro")
    _same(_wxyz(message.orientation), moving, "imu_quat")
    for part in ("orientation", "angular_velocity", "linear_acceleration"):
        assert getattr(message, f"{part}_covariance").tolist() == [0.0] * 9


def test_values_that_an_imu_does_not_measure_are_marked(everything, moving):
    message = _sample(everything, moving, "Imu", {"acc": "accelerometer"})
    assert message.orientation_covariance[0] == -1.0
    assert message.angular_velocity_covariance[0] == -1.0
    assert message.linear_acceleration_covariance[0] == 0.0


def test_a_frame_pose_is_relative_to_the_world(everything, moving):
    names = {"centre_pos": "framepos", "centre_quat": "framequat"}
    message = _sample(everything, moving, "ObkFramePose", names)
    assert (message.header.frame_id, message.frame_name) == ("world", "centre")
    _same(_xyz(message.position), moving, "centre_pos")
    _same(_wxyz(message.orientation), moving, "centre_quat")


def test_a_frame_pose_is_relative_to_the_reference_of_its_sensors(everything, moving):
    names = {"toe_in_base": "framepos", "toe_quat_in_base": "framequat"}
    warnings = []
    message = _sample(everything, moving, "PoseStamped", names, warnings)
    assert message.header.frame_id == "base"
    _same(_xyz(message.pose.position), moving, "toe_in_base")
    assert np.allclose(_wxyz(message.pose.orientation), moving.sensor("toe_quat_in_base").data)
    assert warnings == []


def test_a_pose_in_two_frames_is_warned_about(everything, moving):
    names = {"toe_in_base": "framepos", "toe_quat": "framequat"}
    warnings = []
    message = _sample(everything, moving, "ObkFramePose", names, warnings)
    assert message.header.frame_id == "base"
    (warning,) = warnings
    assert all(name in warning for name in ("`toe_in_base`", "`base`", "`toe_quat`", "`world`"))


def test_forces_stand_in_the_order_of_the_config_with_their_sites(everything, moving):
    moving.sensordata[:] = np.arange(1, len(moving.sensordata) + 1)
    names = {"hip_force": "force", "sole_touch": "touch", "toe_force": "force"}
    message = _sample(everything, moving, "ObkForceSensor", names)
    assert message.header.frame_id == ""
    assert message.frames == ["imu", "sole", "toe"]
    _same(message.forces, moving, "hip_force", "sole_touch", "toe_force")


def test_forces_at_one_site_are_in_its_frame(everything, moving):
    moving.sensordata[:] = np.arange(1, len(moving.sensordata) + 1)
    message = _sample(everything, moving, "ObkForceSensor", {"toe_force": "force"})
    assert message.header.frame_id == "toe"
    _same(message.forces, moving, "toe_force")


def test_odometry_publishes_sensors_at_its_object_unchanged(everything, moving):
    names = {
        "centre_pos": "framepos",
        "centre_quat": "framequat",
        "centre_velocity": "velocimeter",
        "centre_gyro": "gyro",
    }
    message = _sample(everything, moving, "Odometry", names)
    assert (message.header.frame_id, message.child_frame_id) == ("world", "centre")
    _same(_xyz(message.pose.pose.position), moving, "centre_pos")
    _same(_wxyz(message.pose.pose.orientation), moving, "centre_quat")
    _same(_xyz(message.twist.twist.linear), moving, "centre_velocity")
    _same(_xyz(message.twist.twist.angular), moving, "centre_gyro")


def test_odometry_transforms_sensors_elsewhere_on_the_body_to_its_object(everything, moving):
    names = {
        "centre_pos": "framepos",
        "centre_quat": "framequat",
        "velocity": "velocimeter",
        "gyro": "gyro",
    }
    message = _sample(everything, moving, "Odometry", names)
    _same(_xyz(message.twist.twist.linear), moving, "centre_velocity")
    _same(_xyz(message.twist.twist.angular), moving, "centre_gyro")


def test_odometry_is_turned_into_the_frame_of_its_object(everything, moving):
    names = {"imu_quat": "framequat", "centre_velocity": "velocimeter", "centre_gyro": "gyro"}
    message = _sample(everything, moving, "Odometry", names)
    assert message.child_frame_id == "imu"
    _same(_xyz(message.twist.twist.linear), moving, "velocity")
    _same(_xyz(message.twist.twist.angular), moving, "gyro")


def test_odometry_with_a_sensor_on_another_body_warns_and_passes_it_on(everything, moving):
    names = {"centre_pos": "framepos", "centre_quat": "framequat", "toe_velocity": "velocimeter"}
    warnings = []
    message = _sample(everything, moving, "Odometry", names, warnings)
    _same(_xyz(message.twist.twist.linear), moving, "toe_velocity")
    assert warnings == [
        "the sensor `toe_velocity` and the pose of `centre` are on different bodies; its values "
        "are published unchanged"
    ]


def test_odometry_that_cannot_bring_a_velocity_to_its_object_warns(everything, moving):
    names = {"centre_pos": "framepos", "centre_quat": "framequat", "velocity": "velocimeter"}
    warnings = []
    _sample(everything, moving, "Odometry", names, warnings)
    assert warnings == [
        "the sensor `velocity` is not at the pose of `centre`. Without a `gyro` on that "
        "body, the linear velocity is that at the sensor"
    ]
    _sample(everything, moving, "Odometry", {**names, "gyro": "gyro"}, warnings)
    del names["velocity"]
    _sample(everything, moving, "Odometry", {**names, "centre_velocity": "velocimeter"}, warnings)
    assert len(warnings) == 1


def test_odometry_without_a_velocimeter_has_the_rates_alone(everything, moving):
    names = {"centre_pos": "framepos", "centre_quat": "framequat", "gyro": "gyro"}
    message = _sample(everything, moving, "Odometry", names)
    _same(_xyz(message.twist.twist.angular), moving, "centre_gyro")
    assert _xyz(message.twist.twist.linear) == [0.0, 0.0, 0.0]


def test_odometry_without_a_pose_leaves_it_empty(everything, moving):
    message = _sample(everything, moving, "Odometry", {"gyro": "gyro"})
    assert message.header.frame_id == "world"
    assert _xyz(message.pose.pose.position) == [0.0, 0.0, 0.0]
    _same(_xyz(message.twist.twist.angular), moving, "gyro")


def test_each_message_has_the_numbers_of_its_own_state(everything, moving):
    names = {"left_hip_pos": "jointpos", "left_hip_vel": "jointvel"}
    sampler = group(everything, moving, "ObkJointEncoders", names=names)
    before = taken("ObkJointEncoders", sampler).joint_pos.tolist()
    mujoco.mj_step(everything, moving, 10)
    assert taken("ObkJointEncoders", sampler).joint_pos.tolist() != before
