"""The example quadruped: model and kinematics; examples/quadruped/tests test the closed loop."""

import mujoco
import numpy as np
import pytest
from quadruped_py.legs import LEGS, foot_jacobians, foot_positions, joint_angles
from quadruped_py.odometry import rotation_matrix

pytestmark = pytest.mark.mujoco


@pytest.fixture(scope="module")
def model(repository):
    return mujoco.MjModel.from_xml_path(
        str(repository / "examples" / "quadruped" / "model" / "quadruped.xml")
    )


def at_keyframe(model, name):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(name).id)
    mujoco.mj_forward(model, data)
    return data


def poses():
    random = np.random.default_rng(3)
    return random.uniform((-0.7, 0.0, -2.2), (0.7, 1.4, -0.7), (20, 4, 3))


def test_the_masses_are_those_of_a_robot_of_this_size(model):
    assert 11 < mujoco.mj_getTotalmass(model) < 13
    moving = model.body_mass[1:]
    assert (moving > 0.1).all()
    assert (moving < 7).all()


@pytest.mark.parametrize("keyframe", ["ic", "home"])
def test_it_keeps_the_pose_of_a_keyframe(model, keyframe):
    data = at_keyframe(model, keyframe)
    assert min((contact.dist for contact in data.contact), default=0.0) > -0.001
    within = (model.jnt_range[1:, 0] < data.qpos[7:]) & (data.qpos[7:] < model.jnt_range[1:, 1])
    assert within.all()
    start = data.qpos.copy()
    mujoco.mj_step(model, data, 1000)
    assert np.abs(data.qpos - start).max() < 0.06
    assert np.abs(data.qvel).max() < 0.05


def test_the_feet_are_at_the_positions_of_the_model(model):
    data = mujoco.MjData(model)
    for angles in poses():
        data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
        data.qpos[7:] = angles.ravel()
        mujoco.mj_forward(model, data)
        feet = np.array([data.site(f"{leg}_foot").xpos for leg in LEGS])
        assert foot_positions(angles) == pytest.approx(feet, abs=1e-9)
        for leg, jacobian in enumerate(foot_jacobians(angles)):
            expected = np.zeros((3, model.nv))
            site = model.site(f"{LEGS[leg]}_foot").id
            mujoco.mj_jacSite(model, data, expected, None, site)
            assert jacobian == pytest.approx(expected[:, 6 + 3 * leg : 9 + 3 * leg], abs=1e-9)


def test_the_angles_put_the_feet_at_their_targets():
    for angles in poses():
        assert joint_angles(foot_positions(angles)) == pytest.approx(angles, abs=1e-9)


def test_a_foot_out_of_reach_gets_as_close_as_possible():
    feet = foot_positions(np.tile([0.0, 0.5, -1.0], (4, 1)))
    far = joint_angles(feet - [0, 0, 1.0])
    assert far[:, 2] == pytest.approx(0.0, abs=1e-6)


def test_a_quaternion_gives_the_matrix_of_mujoco():
    x, y, z, w = quaternion = np.array([0.1, 0.2, -0.3, 0.9]) / np.sqrt(0.95)
    expected = np.zeros(9)
    mujoco.mju_quat2Mat(expected, np.array([w, x, y, z]))
    assert rotation_matrix(quaternion).ravel() == pytest.approx(expected)
