"""Closed-loop tests of the two-link robot: its nodes and its simulator in lockstep.

Run them from the repository: `obk test examples/dummy/dummy.yaml examples/dummy/tests`.
The comment on each limit is the measured value, the worst of seeds 0 to 4.
"""

import numpy as np
import pytest

CONFIG = "../dummy.yaml"


def test_the_joint_follows_its_command(stack, seed):
    run = stack(CONFIG, seed=seed).run(6.5)  # a full period of sin(t)
    settled = run.t > 0.5  # the joint starts 0.5 rad away from the first command
    error = run.joint("joint1") - np.sin(run.t)
    assert np.abs(error[settled]).max() < 0.05  # 0.038 rad: it lags by 40 ms
    assert not run.faults


def test_each_node_publishes_at_its_rate(stack, seed):
    run = stack(CONFIG, seed=seed).run(1.0)
    for topic in ("/obelisk/dummy/joint_encoders", "/obelisk/dummy/est", "/obelisk/dummy/ctrl"):
        assert len(run[topic]) == pytest.approx(1000, abs=25)  # nodes may start 20 ms late


def test_the_estimate_has_the_noise_of_the_encoders(stack, seed):
    dummy = stack(CONFIG, seed=seed)
    dummy.noise("/obelisk/dummy/joint_encoders", "y", sigma=0.01)  # [rad]
    run = dummy.run(1.0)
    estimates = run["/obelisk/dummy/est"]
    # The estimator publishes empty arrays until the first reading arrives.
    joint = [message.q_joints[0] for message in estimates.messages[-900:]]
    error = joint - np.interp(estimates.t[-900:], run.t, run.joint("joint1"))
    assert error.std() == pytest.approx(0.01, rel=0.1)  # 0.0096 to 0.0103 rad


def test_seeds_differ_in_noise_and_are_reproducible(stack, seed):
    def encoders(seed):
        dummy = stack(CONFIG, seed=seed)
        dummy.noise("/obelisk/dummy/joint_encoders", "y", sigma=0.01)  # [rad]
        return dummy.run(0.5)["/obelisk/dummy/joint_encoders"].y

    noisy = encoders(seed)
    assert np.array_equal(noisy, encoders(seed))
    assert not np.array_equal(noisy, encoders(seed + 1))


def test_without_a_controller_the_drive_holds_the_last_command(stack, seed):
    dummy = stack(CONFIG, seed=seed)
    dummy.run(2.0)
    dummy.kill("control")
    run = dummy.run(1.0)
    commands = run["/obelisk/dummy/ctrl"]
    assert commands.t[-1] <= 2.0
    assert run.joint("joint1")[-1] == pytest.approx(commands.u_mujoco[-1, 0], abs=0.01)
    # 0.0044 rad, because the drive has no integral part and the rod has weight
