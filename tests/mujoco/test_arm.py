"""The example arm: its model and its control law; examples/arm/tests test the closed loop."""

import mujoco
import numpy as np
import pytest
import yaml
from arm_py.law import Gravity, Motion, smoothed

pytestmark = pytest.mark.mujoco


@pytest.fixture(scope="module")
def folder(repository):
    return repository / "examples" / "arm"


@pytest.fixture(scope="module")
def model(folder):
    return mujoco.MjModel.from_xml_path(str(folder / "model" / "arm.xml"))


@pytest.fixture(scope="module")
def params(folder):
    written = yaml.safe_load((folder / "arm.yaml").read_text())["control"]["params"]
    return {name: np.array(value) for name, value in written.items()}


def at_keyframe(model, name):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(name).id)
    mujoco.mj_forward(model, data)
    return data


def test_the_masses_are_those_of_an_arm_of_this_size(model):
    assert 8 < mujoco.mj_getTotalmass(model) < 12
    assert (model.body_mass[1:] > 0.1).all()
    assert (model.body_mass[1:] <= 3).all()


@pytest.mark.parametrize("keyframe", ["ic", "home"])
def test_nothing_touches_at_a_keyframe(model, keyframe):
    assert at_keyframe(model, keyframe).ncon == 0


def test_the_control_of_the_first_keyframe_holds_the_arm(model, folder):
    data = at_keyframe(model, "ic")
    weight = Gravity(folder / "model" / "arm.xml").torques(data.qpos)
    assert data.ctrl == pytest.approx(weight, abs=0.01)
    start = data.qpos.copy()
    mujoco.mj_step(model, data, 1000)
    assert data.qpos == pytest.approx(start, abs=0.02)


def test_no_pose_asks_for_more_than_the_motors_have(model, folder, params):
    gravity = Gravity(folder / "model" / "arm.xml")
    for pose in params["poses"].reshape(-1, 6):
        assert (np.abs(gravity.torques(pose)) < 0.4 * model.actuator_ctrlrange[:, 1]).all()
        assert (model.jnt_range[:, 0] < pose).all()
        assert (pose < model.jnt_range[:, 1]).all()


def test_the_motion_starts_at_the_arm_and_rests_at_each_pose():
    start, poses = np.zeros(6), np.eye(3, 6)
    motion = Motion(start=start, poses=poses, move_s=2.0, rest_s=1.0)
    assert motion.at(0.0)[0] == pytest.approx(start)
    for leg in range(5):
        for within_s in (2.0, 2.5, 2.999):
            angles, speeds = motion.at(3 * leg + within_s)
            assert angles == pytest.approx(poses[leg % 3])
            assert speeds == pytest.approx(np.zeros(6))


def test_the_speed_of_the_motion_is_that_of_its_angles():
    motion = Motion(start=np.zeros(6), poses=np.eye(3, 6), move_s=2.0, rest_s=1.0)
    for time_s in np.arange(0.05, 9.0, 0.1):
        (before, _), (after, _) = motion.at(time_s - 1e-5), motion.at(time_s + 1e-5)
        assert motion.at(time_s)[1] == pytest.approx((after - before) / 2e-5, abs=1e-6)


def test_a_constant_is_not_changed_by_smoothing_and_a_step_is_followed():
    assert smoothed(np.ones(6), np.ones(6), 0.002, 0.005) == pytest.approx(np.ones(6))
    value = np.zeros(6)
    for _ in range(50):
        value = smoothed(value, np.ones(6), 0.002, 0.005)
    assert value == pytest.approx(np.ones(6), abs=1e-6)


def test_smoothed_values_do_not_change_if_time_goes_back():
    assert smoothed(np.zeros(6), np.ones(6), -100.0, 0.005) == pytest.approx(np.zeros(6))


def test_the_fingers_are_above_the_objects_of_the_poses(model, params):
    data = mujoco.MjData(model)
    things = ("red_box", "green_box", "blue_ball")
    for pose, thing in zip(params["poses"].reshape(-1, 6), things, strict=True):
        data.qpos[:] = pose
        mujoco.mj_forward(model, data)
        above = data.site("tip").xpos - data.geom(thing).xpos
        assert np.abs(above[:2]).max() < 0.01
        assert 0.05 < above[2] < 0.15


def test_at_rest_the_wrist_feels_the_weight_of_the_hand(model):
    data = at_keyframe(model, "home")
    weight = model.body("tool").mass[0] * 9.81
    assert data.sensor("wrist_force").data == pytest.approx([0, 0, weight], abs=0.01)
