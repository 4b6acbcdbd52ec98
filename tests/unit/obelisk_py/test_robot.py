"""Numbers in messages: finding values that are not finite, and setting them to zero."""

import pytest
from builtin_interfaces.msg import Time
from obelisk_control_msgs.msg import (
    ExecutionFSM,
    PDFeedForward,
    PositionSetpoint,
    VelocityCommand,
)
from sensor_msgs.msg import Imu
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from obelisk_py.core.robot import non_finite_number, zeroed

HEADER = Header(stamp=Time(sec=3), frame_id="base")
PD = PDFeedForward(
    header=HEADER,
    u_mujoco=[1.0],
    pos_target=[1.0, 2.0],
    vel_target=[3.0, 4.0],
    feed_forward=[5.0, 6.0],
    joint_names=["hip", "knee"],
    kp=[7.0, 8.0],
    kd=[9.0, 10.0],
)


@pytest.mark.parametrize(
    ("message", "zeros"),
    [
        (
            PositionSetpoint(header=HEADER, u_mujoco=[1.0, 2.0], q_des=[3.0]),
            PositionSetpoint(header=HEADER, u_mujoco=[0.0, 0.0], q_des=[0.0]),
        ),
        (
            PD,
            PDFeedForward(
                header=HEADER,
                u_mujoco=[0.0],
                pos_target=[0.0, 0.0],
                vel_target=[0.0, 0.0],
                feed_forward=[0.0, 0.0],
                joint_names=["hip", "knee"],
                kp=[0.0, 0.0],
                kd=[0.0, 0.0],
            ),
        ),
        (VelocityCommand(header=HEADER, v_x=1.0, w_z=-2.0), VelocityCommand(header=HEADER)),
        (ExecutionFSM(header=HEADER, cmd_exec_fsm_state=3), ExecutionFSM(header=HEADER)),
        (
            JointTrajectory(points=[JointTrajectoryPoint(positions=[1.0])], joint_names=["a"]),
            JointTrajectory(points=[JointTrajectoryPoint(positions=[0.0])], joint_names=["a"]),
        ),
    ],
)
def test_every_number_becomes_zero_and_nothing_else_changes(message, zeros):
    before = str(message)
    assert zeroed(message) == zeros
    assert str(message) == before


def test_the_zeros_share_nothing_with_the_message():
    zeros = zeroed(PD)
    zeros.header.stamp.sec = 9
    zeros.joint_names[0] = "ankle"
    assert PD.header.stamp.sec == 3
    assert PD.joint_names[0] == "hip"


@pytest.mark.parametrize(
    ("message", "found"),
    [
        (PD, None),
        (PositionSetpoint(u_mujoco=[0.0, float("nan")]), "`u_mujoco[1]` is nan"),
        (PositionSetpoint(q_des=[float("-inf")]), "`q_des[0]` is -inf"),
        (PDFeedForward(kd=[0.0, float("inf")]), "`kd[1]` is inf"),
        (VelocityCommand(v_y=float("nan")), "`v_y` is nan"),
        (ExecutionFSM(cmd_exec_fsm_state=3), None),
        (
            JointTrajectory(points=[JointTrajectoryPoint(effort=[float("nan")])]),
            "`points[0].effort[0]` is nan",
        ),
    ],
)
def test_the_first_number_that_is_not_finite_is_named(message, found):
    assert non_finite_number(message) == found


def test_an_array_of_fixed_size_is_checked_too():
    imu = Imu()
    imu.orientation_covariance[4] = float("nan")
    assert non_finite_number(imu) == "`orientation_covariance[4]` is nan"
    assert non_finite_number(zeroed(imu)) is None
