"""Closed-loop tests of the arm: its nodes and its simulator in lockstep, in simulated time.

Run them from the repository: `obk test examples/arm/arm.yaml examples/arm/tests`.
The comment on each limit is the measured value, the worst of seeds 0 to 4.
"""

from pathlib import Path

import mujoco
import numpy as np
import pytest

CONFIG = "../arm.yaml"
MODEL = Path(__file__).parents[1] / "model" / "arm.xml"

RED = [-0.11, 0.80, 1.19, 0.0, 1.14, 0.0]
GREEN = [0.56, 0.83, 1.02, 0.0, 1.29, 0.0]
BLUE = [-0.59, 0.71, 1.28, 0.0, 1.15, 0.0]
RESTS = [(RED, 2.6, 3.5), (GREEN, 6.1, 7.0), (BLUE, 9.6, 10.5), (RED, 13.1, 14.0)]
"""The poses [rad], and the start and end of the rest at each [s]."""


def distance(run, pose, begin, end=np.inf):
    """The maximum distance of a joint from a pose in a part of a run [rad]."""
    part = (run.t >= begin) & (run.t < end)
    return np.abs(run.qpos[part] - pose).max()


def contacts(run):
    """The number of contacts during a run, counted every 20 ms."""
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    count = 0
    for qpos in run.qpos[::10]:
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        count += data.ncon
    return count


@pytest.mark.parametrize("late_ms", [0, 10])
def test_it_reaches_each_pose_and_rests_there(stack, seed, late_ms):
    arm = stack(CONFIG, seed=seed, record=[])  # messages are not recorded
    arm.delay("/arm/ctrl", late_ms / 1000)
    run = arm.run(14.0)
    assert not run.faults
    for pose, begin, end in RESTS:
        assert distance(run, pose, begin, end) < 0.01  # 0.0023 rad
        resting = (run.t >= begin) & (run.t < end)
        assert np.abs(run.qvel[resting]).max() < 0.01  # 0.0041 rad/s
    assert contacts(run) == 0


@pytest.mark.parametrize("force", [(0, 0, -60), (0, 80, 0)], ids=["down", "sideways"])
def test_it_recovers_from_a_push_in_half_a_second(stack, seed, force):
    arm = stack(CONFIG, seed=seed)
    arm.run(2.6)
    arm.push("forearm", force, duration=0.1)  # [N]
    run = arm.run(0.8)
    assert distance(run, RED, 2.6, 2.8) > 0.05  # it yields by 0.060 rad and 0.081 rad
    assert distance(run, RED, 3.2) < 0.005  # 0.0014 rad
    assert not run.faults


@pytest.mark.parametrize("late_ms", [0, 2, 4, 8])
def test_it_arrives_with_late_estimates(stack, seed, late_ms):
    arm = stack(CONFIG, seed=seed)
    arm.delay("/arm/est", late_ms / 1000)
    run = arm.run(3.4)
    assert distance(run, RED, 2.6) < 0.01  # 0.0023 rad
    assert not run.faults


def test_it_arrives_when_three_of_ten_estimates_are_lost(stack, seed):
    arm = stack(CONFIG, seed=seed)
    arm.drop("/arm/est", share=0.3)
    run = arm.run(3.4)
    assert distance(run, RED, 2.6) < 0.01  # 0.0023 rad
    assert not run.faults


def test_it_arrives_when_the_estimator_freezes_for_a_tenth_of_a_second(stack, seed):
    arm = stack(CONFIG, seed=seed)
    arm.run(1.2)  # the arm moves at its highest speed
    arm.freeze("estimation", duration=0.1)
    run = arm.run(2.2)
    assert np.diff(run["/arm/est"].t).max() == pytest.approx(0.1, abs=0.005)
    assert distance(run, RED, 2.6) < 0.01  # 0.0023 rad
    assert not run.faults


def test_without_a_controller_the_drives_hold_the_last_target(stack, seed):
    arm = stack(CONFIG, seed=seed)
    moving = arm.run(1.2)
    arm.kill("control")
    run = arm.run(1.0)
    assert run["/arm/ctrl"].t[-1] <= 1.2
    # Each message also has a target speed, here 0.98 rad/s, so the drives overshoot.
    assert distance(run, moving.qpos[-1], 1.2) < 0.12  # 0.094 rad
    assert np.abs(run.qvel[-1]).max() < 0.01  # 0.0013 rad/s


def test_a_robot_with_max_age_brakes_when_its_controller_dies(stack, seed):
    settings = [
        "robot.subscribers[0].max_age_sec=0.05",
        "robot.subscribers[0].stale_action=damp",
    ]
    arm = stack(CONFIG, seed=seed, set=settings)
    arm.run(3.0)
    arm.kill("control")
    run = arm.run(1.0)
    assert any("the robot brakes" in entry.text for entry in run.log)
    # The arm sinks slowly, because it brakes.
    assert np.abs(run.qvel[run.t > 3.0]).max() < 1.6  # 1.3 rad/s, and 2.0 rad/s without brakes


def test_the_same_seed_gives_an_identical_run(stack, seed):
    one, two = (stack(CONFIG, seed=seed).run(1.0) for _ in range(2))
    assert one.first_difference(two) is None
