"""Closed-loop tests of the cart-pole: its network, nodes and simulator in lockstep.

Run them from the repository: `obk test examples/cartpole/cartpole.yaml`.
The comment on each limit is the measured value, the worst of seeds 0 to 4.
"""

import numpy as np


def test_the_network_balances_the_pole(stack, seed):
    run = stack("../cartpole.yaml", seed=seed).run(6.0)
    assert np.abs(run.joint("hinge")[run.t > 4.0]).max() < 0.011  # 0.0055 rad
    assert np.abs(run.joint("slide")).max() < 0.36  # 0.18 m


def test_it_recovers_from_a_push(stack, seed):
    robot = stack("../cartpole.yaml", seed=seed)
    robot.run(3.0)
    robot.push("cart", [20.0, 0.0, 0.0], duration=0.1)
    run = robot.run(5.0)
    assert np.abs(run.joint("hinge")).max() < 0.52  # 0.26 rad
    assert np.abs(run.joint("hinge")[run.t > 7.0]).max() < 0.012  # 0.006 rad
