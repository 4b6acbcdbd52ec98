"""Closed-loop tests of the arm: run them with `obk test examples/arm/arm.yaml`."""

import numpy as np

ARRIVED = [-0.11, 0.80, 1.19, 0.0, 1.14, 0.0]
"""Where the arm stands from 2.6 s on [rad]."""


def test_a_push_is_gone_in_half_a_second(stack, seed):
    arm = stack("../arm.yaml", seed=seed)
    arm.run(2.6)
    arm.push("forearm", np.random.default_rng(seed).normal(0, 15, 3), duration=0.1)
    run = arm.run(0.8)
    assert np.abs(run.qpos - ARRIVED)[run.t >= 3.2].max() < 0.01
    assert not run.faults
