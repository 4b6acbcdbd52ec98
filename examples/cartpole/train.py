"""Train `policy/balance.onnx`, a network of 4-16-1 neurons that balances the pole.

    pip install onnx
    python examples/cartpole/train.py

Takes about three minutes. It uses random search in the space of weights: each step evaluates random
directions in both senses and moves along the best ones, in proportion to the gain in reward.

Source: H. Mania, A. Guy, B. Recht, Simple random search of static linear policies is competitive
for reinforcement learning, NeurIPS 2018, https://arxiv.org/abs/1803.07055, algorithm ARS V1-t.
"""

import sys
from pathlib import Path

import mujoco
import numpy as np

HERE = Path(__file__).parent
POLICY = HERE / "policy" / "balance.onnx"
INPUTS, HIDDEN = 4, 16
PERIOD_S = 0.01
"""Time between two actions [s], as in `timer_ctrl` of the config."""
FORCE = 20.0
"""As in `action_scale` of the config [N]."""
EPISODE_S = 4.0
STEPS, DIRECTIONS, BEST = 80, 12, 6
STEP_SIZE, NOISE = 0.06, 0.08
STATES = 3
"""Number of initial states for each weight vector."""


def layers(weights):
    """Split the weights into the matrices and offsets of the network."""
    first, rest = np.split(weights, [INPUTS * HIDDEN])
    offsets, second = np.split(rest, [HIDDEN])
    return first.reshape(INPUTS, HIDDEN), offsets, second.reshape(HIDDEN, 1)


def reward(model, data, weights, state):
    """The reward of an episode: at most 1 per action, nothing after a fall."""
    first, offsets, second = layers(weights)
    mujoco.mj_resetData(model, data)
    mass = model.body_mass[2]
    model.body_mass[2] = state[4]
    data.qpos[:], data.qvel[:] = state[:2], state[2:4]
    substeps = round(PERIOD_S / model.opt.timestep)
    earned = 0.0
    for _ in range(round(EPISODE_S / PERIOD_S)):
        observed = np.concatenate((data.qpos, data.qvel))
        action = np.tanh(np.tanh(observed @ first + offsets) @ second)[0]
        data.ctrl[0] = FORCE * action
        mujoco.mj_step(model, data, substeps)
        if abs(data.qpos[1]) > 0.8 or abs(data.qpos[0]) > 1.4:
            break
        earned += 1.0 - data.qpos[1] ** 2 - 0.2 * data.qpos[0] ** 2 - 0.02 * action**2
    model.body_mass[2] = mass
    return earned


def train(seed=0):
    """Return the weights after `STEPS` steps."""
    model = mujoco.MjModel.from_xml_path(str(HERE / "model" / "cartpole.xml"))
    data = mujoco.MjData(model)
    random = np.random.default_rng(seed)
    weights = 0.1 * random.standard_normal(INPUTS * HIDDEN + HIDDEN + HIDDEN)
    for step in range(STEPS):
        width = [0.4, 0.25, 0.3, 0.3]
        states = random.uniform(-1.0, 1.0, (STATES, 5)) * [*width, 0.1] + [0, 0, 0, 0, 0.2]
        directions = random.standard_normal((DIRECTIONS, weights.size))
        both = np.array(
            [
                [
                    sum(reward(model, data, weights + sign * NOISE * way, s) for s in states)
                    for sign in (1, -1)
                ]
                for way in directions
            ]
        )
        best = np.argsort(both.max(axis=1))[-BEST:]
        spread = both[best].std() + 1e-9
        gain = (both[best, 0] - both[best, 1]) @ directions[best]
        weights += STEP_SIZE / (BEST * spread) * gain
        earned = both.mean() / STATES / (EPISODE_S / PERIOD_S)
        print(f"step {step + 1:3} of {STEPS}: {earned:.3f} of 1", flush=True)
    return weights


def save(weights):
    """Write the network as ONNX, with input `observation` (1, 4) and output `action` (1, 1)."""
    from onnx import TensorProto, checker, helper, numpy_helper, save_model

    first, offsets, second = layers(weights.astype(np.float32))
    kind = TensorProto.FLOAT
    graph = helper.make_graph(
        [
            helper.make_node("Gemm", ["observation", "first", "offsets"], ["sum"]),
            helper.make_node("Tanh", ["sum"], ["hidden"]),
            helper.make_node("MatMul", ["hidden", "second"], ["output"]),
            helper.make_node("Tanh", ["output"], ["action"]),
        ],
        "balance",
        [helper.make_tensor_value_info("observation", kind, [1, INPUTS])],
        [helper.make_tensor_value_info("action", kind, [1, 1])],
        [
            numpy_helper.from_array(first, "first"),
            numpy_helper.from_array(offsets, "offsets"),
            numpy_helper.from_array(second, "second"),
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    checker.check_model(model)
    POLICY.parent.mkdir(exist_ok=True)
    save_model(model, POLICY)


if __name__ == "__main__":
    save(train(int(sys.argv[1]) if len(sys.argv) > 1 else 0))
