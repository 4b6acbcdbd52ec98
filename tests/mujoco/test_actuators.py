"""`PDFeedForward` with gains becomes a torque at each joint, at every step."""

import mujoco
import numpy as np
import pytest
from obelisk_control_msgs.msg import PDFeedForward

from obelisk_py.core.sim.mujoco.actuators import JointTorques, has_gains
from obelisk_py.core.sim.mujoco.control import ControlInbox
from obelisk_py.core.sim.mujoco.simulation import Simulation

from .two_joints import ARM, arm

pytestmark = pytest.mark.mujoco

MOTORS = '<motor joint="knee" gear="4"/><motor joint="hip"/>'
"""In a different order than the joints."""
SERVOS = '<position joint="knee" kp="30" kv="2" gear="2"/><velocity joint="hip" kv="5"/>'
OFFSET = (
    '<general joint="knee" gainprm="30" biastype="affine" biasprm="3 -30 -2"/><motor joint="hip"/>'
)
"""A servo whose force is not zero at its current position."""
GAINS = {
    "pos_target": [0.4, -0.2],
    "vel_target": [0.1, 0.3],
    "feed_forward": [1.0, 2.0],
    "kp": [20.0, 10.0],
    "kd": [2.0, 1.0],
}


def simulation(model):
    inbox = ControlInbox(
        field="u_mujoco", size=model.nu, monotonic_s=lambda: 0.0, torques=JointTorques(model)
    )
    made = Simulation(model, inbox)
    made.reset(None)
    return made, inbox


@pytest.mark.parametrize("actuators", [MOTORS, SERVOS, OFFSET], ids=["motors", "servos", "offset"])
@pytest.mark.parametrize("names", [["hip", "knee"], ["knee", "hip"]])
def test_each_joint_has_the_torque_of_the_law_with_any_actuator(actuators, names):
    model = arm(actuators)
    data = mujoco.MjData(model)
    data.qpos[:] = [0.3, -0.5]
    data.qvel[:] = [-0.7, 0.9]
    mujoco.mj_step1(model, data)
    order = [names.index(name) for name in ("hip", "knee")]
    law = JointTorques(model).read(PDFeedForward(joint_names=names, **GAINS))
    data.ctrl[:] = JointTorques(model).control(law, data)
    mujoco.mj_step2(model, data)
    pos, vel, ahead, kp, kd = (np.array(values)[order] for values in GAINS.values())
    wanted = kp * (pos - [0.3, -0.5]) + kd * (vel - [-0.7, 0.9]) + ahead
    assert data.qfrc_actuator == pytest.approx(wanted)


def test_without_names_the_order_is_that_of_the_actuators():
    model = arm(MOTORS)
    torques = JointTorques(model)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    law = torques.read(PDFeedForward(feed_forward=[8.0, 3.0], kd=[0.0, 0.0]))
    assert torques.control(law, data).tolist() == [2.0, 3.0]


def test_the_law_is_evaluated_at_every_step_even_in_a_batch():
    one, one_inbox = simulation(arm(MOTORS))
    many, many_inbox = simulation(arm(MOTORS))
    for inbox in (one_inbox, many_inbox):
        assert inbox.offer(PDFeedForward(joint_names=["hip", "knee"], **GAINS))
    for _ in range(100):
        one.advance()
    many.advance(100)
    assert many.data.qpos.tobytes() == one.data.qpos.tobytes()


def test_the_joints_go_to_their_targets():
    made, inbox = simulation(arm(MOTORS))
    targets = PDFeedForward(pos_target=[0.5, -0.5], kp=[50.0, 50.0], kd=[10.0, 10.0])
    assert inbox.offer(targets)
    made.advance(3_000)
    assert made.data.qpos == pytest.approx([-0.5, 0.5], abs=1e-2)


def test_without_gains_it_is_u_mujoco_that_counts():
    made, inbox = simulation(arm(MOTORS))
    assert not has_gains(PDFeedForward(u_mujoco=[1.0, 2.0]))
    assert inbox.offer(PDFeedForward(u_mujoco=[1.0, 2.0], pos_target=[9.0]))
    made.advance()
    assert made.data.ctrl.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("gain", ["kp", "kd"])
def test_one_gain_is_enough_for_torques(gain):
    made, inbox = simulation(arm(MOTORS))
    assert inbox.offer(
        PDFeedForward(pos_target=[1.0, 2.0], vel_target=[1.0, 2.0], **{gain: [8, 3]})
    )
    made.advance()
    assert made.data.ctrl.tolist() == [2.0, 6.0]


def test_after_gains_a_message_without_them_counts_again():
    made, inbox = simulation(arm(MOTORS))
    assert inbox.offer(PDFeedForward(**GAINS))
    made.advance()
    assert inbox.offer(PDFeedForward(u_mujoco=[0.0, 0.0]))
    made.advance()
    assert made.data.ctrl.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("change", "rejection"),
    [
        ({"kp": [1.0]}, "`kp` has the length 1, expected 2 (one per joint)"),
        ({"kd": [1.0] * 3}, "`kd` has the length 3, expected 2 (one per joint)"),
        ({"pos_target": []}, "`pos_target` has the length 0, expected 2 (one per joint)"),
        ({"vel_target": [0.0]}, "`vel_target` has the length 1, expected 2 (one per joint)"),
        ({"feed_forward": [0.0]}, "`feed_forward` has the length 1, expected 2 (one per joint)"),
        ({"pos_target": [float("nan"), 0.0]}, "`pos_target[0]` is nan"),
        ({"vel_target": [0.0, float("inf")]}, "`vel_target[1]` is inf"),
        ({"feed_forward": [0.0, float("-inf")]}, "`feed_forward[1]` is -inf"),
        ({"kp": [0.0, float("nan")]}, "`kp[1]` is nan"),
        ({"kd": [2e10, 0.0]}, "`kd[0]` is 2e+10"),
        (
            {"joint_names": ["hip", "ankle"]},
            "`joint_names` is `hip`, `ankle`, but the model drives `knee`, `hip`: missing `knee`, "
            "not expected `ankle`",
        ),
        (
            {"joint_names": ["hip", "hip"]},
            "`joint_names` is `hip`, `hip`, but the model drives `knee`, `hip`: missing `knee`, "
            "not expected `hip`",
        ),
        (
            {"joint_names": ["hip"]},
            "`joint_names` is `hip`, but the model drives `knee`, `hip`: missing `knee`",
        ),
    ],
)
def test_anything_but_one_finite_number_per_joint_is_rejected(change, rejection):
    message = PDFeedForward(**{**GAINS, **change})
    assert JointTorques(arm(MOTORS)).read(message) == rejection


@pytest.mark.parametrize("field", ["vel_target", "feed_forward", "kp", "kd"])
def test_empty_fields_are_zero(field):
    torques = JointTorques(arm(MOTORS))
    empty = torques.read(PDFeedForward(**{**GAINS, field: []}))
    zeros = torques.read(PDFeedForward(**{**GAINS, field: [0.0, 0.0]}))
    for name in GAINS:
        assert getattr(empty, name).tolist() == getattr(zeros, name).tolist()


@pytest.mark.parametrize(
    ("actuators", "rejection"),
    [
        (
            '<motor joint="hip"/><motor name="second" joint="hip"/>',
            "two actuators drive the joint `hip`",
        ),
        (
            '<motor joint="hip"/><intvelocity name="slow" joint="knee" actrange="-1 1"/>',
            "gains need torques, but the actuator `slow` takes no torque",
        ),
        (
            '<adhesion name="sticky" body="torso" ctrlrange="0 1"/>',
            "gains need joints, but the actuator `sticky` drives no hinge or slide",
        ),
    ],
)
def test_a_model_that_cannot_follow_reports_why(actuators, rejection):
    model = mujoco.MjModel.from_xml_string(
        ARM.format(actuators=actuators).replace("<body><joint", '<body name="torso"><joint')
    )
    assert JointTorques(model).read(PDFeedForward(**GAINS)) == rejection


def test_an_unbounded_law_is_clipped_to_its_bounds():
    model = arm(MOTORS)
    torques = JointTorques(model)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    law = torques.read(PDFeedForward(pos_target=[1e9, -1e9], kp=[1e10, 1e10]))
    assert torques.control(law, data).tolist() == [1e10, -1e10]
