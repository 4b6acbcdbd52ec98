"""Two runs of one scripted controller as fast as possible are identical."""

import numpy as np
import pytest
from obelisk_sensor_msgs.msg import ObkJointEncoders
from rclpy.serialization import deserialize_message

from obelisk_py.core.sim.mujoco.control import ControlInbox
from obelisk_py.core.sim.mujoco.outputs import OutputContext, outputs_of
from obelisk_py.core.sim.mujoco.sim_config import typed_block
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.stepper import Stepper

pytestmark = pytest.mark.mujoco

STEPS = 3_000
ENCODERS = {
    "topic": "/q",
    "dt": 0.01,
    "msg_type": "ObkJointEncoders",
    "sensor_names": {
        "left_hip_pos": "jointpos",
        "right_hip_pos": "jointpos",
        "left_hip_vel": "jointvel",
        "right_hip_vel": "jointvel",
    },
    "noise": {"joint_pos": {"sigma": 0.01}},
    "dropout": 0.1,
    "delay": 0.004,
}


class _Control:
    def __init__(self, u):
        self.u = u


class _IrregularClock:
    """A wall clock with a different rate in every run, so that steps are batched differently."""

    def __init__(self, seed):
        self._random = np.random.default_rng(seed)
        self._ns = 0

    def now_ns(self):
        self._ns += int(self._random.integers(1_000, 300_000))
        return self._ns


def _trajectory(model, seed):
    """The states at every message that the controller responds to, and the last state."""
    inbox = ControlInbox(field="u", size=model.nu, monotonic_s=lambda: 0.0)
    simulation = Simulation(model, inbox)
    states, steps = [], []

    def control(data):
        message = deserialize_message(data, ObkJointEncoders)
        states.append(np.concatenate([simulation.data.qpos, simulation.data.qvel]))
        steps.append(simulation.steps)
        swing = np.sin(0.05 * simulation.steps + np.arange(2))
        error = 0.3 * swing - np.array(message.joint_pos)
        assert inbox.offer(_Control(5.0 * error - 0.1 * np.array(message.joint_vel)))

    class _Publisher:
        def __init__(self, *_):
            self.publish = control
            self.get_subscription_count = lambda: 1

    block = typed_block({"model_xml_path": "m", "sensor_settings": [ENCODERS]})
    surroundings = OutputContext(
        make_publisher=_Publisher, warn=pytest.fail, on_close=pytest.fail, is_paced=False
    )
    simulation.reset(None)
    Stepper(
        simulation,
        pace=None,
        clock=_IrregularClock(seed),
        outputs=outputs_of(simulation, block, surroundings),
        stamp=lambda: simulation.time_ns,
        warn=pytest.fail,
        report=lambda _: None,
    ).run(lambda: simulation.steps >= STEPS)
    assert simulation.data.ncon > 0, "contacts are part of the comparison"
    return np.array(states), steps


def test_two_runs_of_a_scripted_controller_are_identical(everything):
    one, one_steps = _trajectory(everything, seed=1)
    other, other_steps = _trajectory(everything, seed=2)
    assert len(one) > 500
    assert one_steps == other_steps
    assert one.tobytes() == other.tobytes()
