"""The field layouts of the messages, which must not change because deployed robots use them."""

from pathlib import Path

import pytest

STATE = (
    "float64[] q_base",
    "string base_link_name",
    "float64[] q_joints",
    "string[] joint_names",
    "float64[] v_base",
    "float64[] v_joints",
)
HEADER = "std_msgs/Header header"
CONTRACT = {
    "obelisk_std_msgs/FloatMultiArray": ("std_msgs/MultiArrayLayout layout", "float64[] data"),
    "obelisk_std_msgs/UInt8MultiArray": ("std_msgs/MultiArrayLayout layout", "uint8[] data"),
    "obelisk_control_msgs/PositionSetpoint": (HEADER, "float64[] u_mujoco", "float64[] q_des"),
    "obelisk_control_msgs/PDFeedForward": (
        HEADER,
        "float64[] u_mujoco",
        "float64[] pos_target",
        "float64[] vel_target",
        "float64[] feed_forward",
        "string[] joint_names",
        "float64[] kp",
        "float64[] kd",
    ),
    "obelisk_control_msgs/VelocityCommand": (HEADER, "float64 v_x", "float64 v_y", "float64 w_z"),
    "obelisk_control_msgs/ExecutionFSM": (HEADER, "uint8 cmd_exec_fsm_state"),
    "obelisk_estimator_msgs/EstimatedState": (HEADER, *STATE),
    "obelisk_sensor_msgs/ObkJointEncoders": (
        HEADER,
        "builtin_interfaces/Time stamp",
        "float64[] joint_pos",
        "float64[] joint_vel",
        "float64[] motor_surface_temps",
        "float64[] motor_winding_temps",
        "uint32[] motor_states",
        "string[] joint_names",
    ),
    "obelisk_sensor_msgs/JointEncoders": (HEADER, "float64[] y"),
    "obelisk_sensor_msgs/ObkImu": (
        HEADER,
        "geometry_msgs/Quaternion orientation",
        "float64[9] orientation_covariance",
        "geometry_msgs/Vector3 angular_velocity",
        "float64[9] angular_velocity_covariance",
        "geometry_msgs/Vector3 linear_acceleration",
        "float64[9] linear_acceleration_covariance",
    ),
    "obelisk_sensor_msgs/ObkFramePose": (
        HEADER,
        "string frame_name",
        "geometry_msgs/Quaternion orientation",
        "geometry_msgs/Vector3 position",
    ),
    "obelisk_sensor_msgs/ObkForceSensor": (HEADER, "float64[] forces", "string[] frames"),
    "obelisk_sensor_msgs/ObkScan": (HEADER, "float32[] data"),
    "obelisk_sensor_msgs/ObkImage": ("obelisk_std_msgs/UInt8MultiArray y",),
    "obelisk_sensor_msgs/TrueSimState": ("float64[] y", HEADER, *STATE),
}


def definitions(repository: Path) -> dict[str, Path]:
    files = (repository / "interfaces").glob("obelisk_*/msg/*.msg")
    return {f"{file.parents[1].name}/{file.stem}": file for file in files}


@pytest.mark.parametrize("name", CONTRACT)
def test_the_fields_and_their_order_are_those_of_the_contract(repository: Path, name: str) -> None:
    lines = definitions(repository)[name].read_text().splitlines()
    fields = [line for line in lines if line and not line.startswith("#")]
    assert fields[0] == f'string MESSAGE_NAME="{name.partition("/")[2]}"'
    assert tuple(fields[1:]) == CONTRACT[name]


def test_no_message_is_without_a_contract(repository: Path) -> None:
    assert definitions(repository).keys() == CONTRACT.keys()


@pytest.mark.parametrize("name", CONTRACT)
def test_every_message_is_listed_for_colcon(repository: Path, name: str) -> None:
    package, _, message = name.partition("/")
    listing = (repository / "interfaces" / package / "CMakeLists.txt").read_text()
    assert f'"msg/{message}.msg"' in listing
