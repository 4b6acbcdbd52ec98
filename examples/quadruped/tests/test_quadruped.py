"""Closed-loop tests of the quadruped: its nodes and its simulator in lockstep.

Run them from the repository: `obk test examples/quadruped/quadruped.yaml examples/quadruped/tests`.
The comment on each limit is the measured value, the worst of seeds 0 to 4.

The robot stands up for 2 s, sways for 6 s, trots for 6 s, and so on.
"""

from pathlib import Path

import mujoco
import numpy as np
import pytest

CONFIG = "../quadruped.yaml"
MODEL = Path(__file__).parents[1] / "model" / "quadruped.xml"

STANDS_UP_S = 2.5
SWAYS = (2.5, 7.5)
TROTS = (8.5, 13.5)


def part(run, begin, end=np.inf):
    """The states in a part of a run: position [m] and quaternion of the trunk, joints [rad]."""
    return run.qpos[(run.t >= begin) & (run.t < end)]


def tilt(qpos):
    """The tilt of the trunk in each state [deg]."""
    x, y = qpos[:, 4], qpos[:, 5]
    return np.degrees(np.arccos(1 - 2 * (x**2 + y**2)))


def feet_heights(qpos):
    """The heights of the four feet every 20 ms [m], shape `(n, 4)`."""
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    rows = []
    for state in qpos[::10]:
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        rows.append([data.site(f"{leg}_foot").xpos[2] for leg in ("fl", "fr", "rl", "rr")])
    return np.array(rows)


def stands(qpos):
    """Whether the trunk is upright and at standing height, in each state."""
    return (qpos[:, 2] > 0.25) & (qpos[:, 2] < 0.34) & (tilt(qpos) < 15)


@pytest.mark.parametrize(("late_ms", "duration"), [(0, 26.0), (20, 14.0)])
def test_it_stands_up_sways_and_trots_on_the_spot(stack, seed, late_ms, duration):
    quadruped = stack(CONFIG, seed=seed, record=["/quadruped/est"])  # record no other messages
    quadruped.delay("/quadruped/ctrl", late_ms / 1000)
    run = quadruped.run(duration)
    assert not run.faults
    standing = part(run, STANDS_UP_S)
    assert stands(standing).all()
    assert tilt(run.qpos).max() < 5  # 1.7 deg
    assert np.abs(run.qpos[:, :2]).max() < 0.2  # 0.11 m from where it started

    sways, trots = part(run, *SWAYS), part(run, *TROTS)
    assert np.ptp(sways[:, 1]) > 0.04  # 0.080 m from left to right
    assert feet_heights(sways).max() < 0.03  # 0.021 m: no foot is lifted
    assert (feet_heights(trots).max(axis=0) > 0.04).all()  # 0.051 m: each foot is lifted

    estimate = run["/quadruped/est"]
    places = np.column_stack([np.interp(estimate.t, run.t, run.qpos[:, axis]) for axis in range(3)])
    error = np.abs(estimate.q_base[:, :3] - places)
    assert error[:, :2].max() < 0.05  # 0.021 m
    assert error[estimate.t > STANDS_UP_S, 2].max() < 0.015  # 0.0073 m


@pytest.mark.parametrize(
    "force", [(60, 0, 0), (-60, 0, 0), (0, 60, 0), (0, -60, 0)], ids="front back left right".split()
)
def test_it_does_not_fall_after_a_push(stack, seed, force):
    quadruped = stack(CONFIG, seed=seed)
    quadruped.run(2.1)
    quadruped.push("trunk", force, duration=0.1)  # [N]
    run = quadruped.run(1.2)
    pushed = part(run, 2.1)
    assert stands(pushed).all()
    assert 0.8 < tilt(pushed).max() < 5  # 1.0 to 2.0 deg
    assert tilt(pushed[-100:]).max() < 2  # 1.1 deg
    assert not run.faults


@pytest.mark.parametrize("late_ms", [2, 8])
def test_it_stands_up_with_late_estimates(stack, seed, late_ms):
    quadruped = stack(CONFIG, seed=seed)
    quadruped.delay("/quadruped/est", late_ms / 1000)
    run = quadruped.run(2.5)
    assert tilt(run.qpos).max() < 2  # 0.70 deg
    assert run.qpos[-1, 2] == pytest.approx(0.300, abs=0.01)  # 0.3015 m
    assert not run.faults


def test_it_stands_up_when_the_estimator_freezes_for_a_tenth_of_a_second(stack, seed):
    quadruped = stack(CONFIG, seed=seed)
    quadruped.run(1.0)  # halfway up
    quadruped.freeze("estimation", duration=0.1)
    run = quadruped.run(1.5)
    assert np.diff(run["/quadruped/est"].t).max() == pytest.approx(0.1, abs=0.005)
    assert tilt(run.qpos).max() < 2  # 0.70 deg
    assert run.qpos[-1, 2] == pytest.approx(0.300, abs=0.01)  # 0.3015 m
    assert not run.faults


@pytest.mark.parametrize("stale_action", ["hold", "damp"])
def test_it_keeps_standing_when_its_controller_dies(stack, seed, stale_action):
    settings = [
        "robot.subscribers[0].max_age_sec=0.1",
        f"robot.subscribers[0].stale_action={stale_action}",
    ]
    quadruped = stack(CONFIG, seed=seed, set=settings)
    quadruped.run(3.0)  # the robot sways
    quadruped.kill("control")
    run = quadruped.run(1.5)
    left = part(run, 3.0)
    assert run["/quadruped/ctrl"].t[-1] <= 3.0
    assert any("no command for" in entry.text for entry in run.log)
    assert stands(left).all()
    assert tilt(left).max() < 5  # 1.8 deg
    assert np.abs(run.qvel[-1]).max() < 0.01  # 0.0015 m/s or rad/s: the robot is at rest


def test_seeds_change_the_noise_but_not_the_motion(stack, seed):
    one, other = (stack(CONFIG, seed=each).run(2.5) for each in (seed, seed + 1))
    assert one.digest() != other.digest()
    # 0.011 m or rad, mostly because nodes start up to 20 ms apart
    assert np.abs(one.qpos[-1] - other.qpos[-1]).max() < 0.03
