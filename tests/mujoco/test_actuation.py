"""Controls after commands have become old: zeros, the last control, or damping."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from obelisk_py.core.command_watchdog import CommandAge, StalePolicy
from obelisk_py.core.sim.mujoco.actuators import BRAKING_TIME_S, Actuators, Brake
from obelisk_py.core.sim.mujoco.control import ControlInbox, WhenStale
from obelisk_py.core.sim.mujoco.simulation import Simulation

from .two_joints import arm

pytestmark = pytest.mark.mujoco

MOTORS = '<motor joint="hip" gear="3"/><general joint="knee" gainprm="2"/>'


class Run:
    """A simulation whose wall clock the test sets; commands are old after half a second."""

    def __init__(self, model, action):
        self.now_s = 100.0
        self.age = CommandAge(StalePolicy(max_age_s=0.5, action=action))
        self.reported = []
        self.inbox = ControlInbox(field="u", size=model.nu, monotonic_s=lambda: 0.0)
        self.simulation = Simulation(
            model, self.inbox, WhenStale(action=action, is_stale=self._is_stale)
        )
        self.simulation.reset(None)
        self.data = self.simulation.data

    def command(self, *values):
        assert self.inbox.offer(SimpleNamespace(u=values))
        self.age.accept(self.now_s)

    def _is_stale(self):
        age_s = self.age.look(self.now_s)
        self.reported += [] if age_s is None else [age_s]
        return self.age.is_stale


def test_the_first_step_after_the_deadline_has_zeros():
    run = Run(arm(MOTORS), "zero")
    run.command(1.0, 2.0)
    run.now_s += 0.5
    run.simulation.advance()
    assert run.data.ctrl.tolist() == [1.0, 2.0]
    run.now_s += 0.001
    run.simulation.advance()
    assert run.data.ctrl.tolist() == [0.0, 0.0]
    assert run.reported == [pytest.approx(0.501)]


@pytest.mark.parametrize("action", ["zero", "damp"])
def test_the_next_command_is_applied_immediately(action):
    run = Run(arm(MOTORS), action)
    run.command(1.0, 2.0)
    run.now_s += 0.6
    run.simulation.advance()
    run.command(1.0, 2.0)
    run.simulation.advance()
    assert run.data.ctrl.tolist() == [1.0, 2.0]
    run.now_s += 0.6
    run.simulation.advance()
    assert len(run.reported) == 2


@pytest.mark.parametrize("action", ["zero", "hold", "damp"])
def test_before_the_first_command_the_robot_keeps_its_initial_pose(action):
    run = Run(arm(MOTORS), action)
    run.data.ctrl[:] = [3.0, 4.0]
    run.now_s += 1e6
    run.simulation.advance()
    assert run.data.ctrl.tolist() == [3.0, 4.0]
    assert run.reported == []


def test_hold_only_reports():
    run = Run(arm(MOTORS), "hold")
    run.command(1.0, 2.0)
    for _ in range(5):
        run.now_s += 0.2
        run.simulation.advance()
    assert run.data.ctrl.tolist() == [1.0, 2.0]
    assert len(run.reported) == 1


def test_a_reset_ends_it():
    run = Run(arm(MOTORS), "zero")
    run.command(1.0, 2.0)
    run.now_s += 0.6
    run.simulation.advance()
    run.simulation.reset(None)
    run.age.forget()
    run.data.ctrl[:] = [3.0, 4.0]
    run.simulation.advance()
    assert run.data.ctrl.tolist() == [3.0, 4.0]


@pytest.mark.parametrize(
    "actuator", ['<motor joint="j" gear="5"/>', '<general joint="j" gainprm="4" gear="3"/>']
)
def test_a_single_load_slows_down_by_its_time_constant(actuator):
    xml = f"""
    <mujoco><option timestep="0.001" gravity="0 0 0"/>
      <worldbody><body><joint name="j"/><geom size="0.1" pos="0.3 0 0"/></body></worldbody>
      <actuator>{actuator}</actuator></mujoco>"""
    run = Run(mujoco.MjModel.from_xml_string(xml), "damp")
    run.data.qvel[0] = 2.0
    mujoco.mj_forward(run.simulation.model, run.data)
    run.command(0.0)
    run.now_s += 0.6
    run.simulation.advance(round(BRAKING_TIME_S / 0.001))
    assert run.data.qvel[0] == pytest.approx(2.0 * np.exp(-1.0), rel=0.02)
    run.simulation.advance(1_000)
    assert abs(run.data.qvel[0]) < 1e-3


def test_several_motors_bring_coupled_joints_to_rest():
    run = Run(arm(MOTORS), "damp")
    run.data.qvel[:] = [3.0, -5.0]
    mujoco.mj_forward(run.simulation.model, run.data)
    run.command(0.0, 0.0)
    run.now_s += 0.6
    run.simulation.advance(500)
    assert np.abs(run.data.qvel).max() < 1.0
    run.simulation.advance(5_000)
    assert np.abs(run.data.qvel).max() < 1e-2


def brake_control(actuators, qpos, qvel):
    model = arm(actuators)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    data.qvel[:] = qvel
    mujoco.mj_forward(model, data)
    return Brake(Actuators(model), model, data).control(data.actuator_velocity).tolist()


@pytest.mark.parametrize(
    ("actuator", "control"),
    [
        ('<position joint="hip" kp="30" kv="2"/>', 0.7),
        ('<position joint="hip" kp="30" gear="2"/>', 1.4),
        ('<position joint="hip" kp="30" ctrlrange="-0.5 0.5" ctrllimited="true"/>', 0.5),
        ('<position joint="hip" kp="30" timeconst="0.1"/>', 0.7),
        ('<general joint="hip" gainprm="30" biastype="affine" biasprm="3 -30 -2"/>', 0.6),
        ('<velocity joint="hip" kv="5"/>', 0.0),
        ('<intvelocity joint="hip" kp="5" actrange="-1 1"/>', 0.0),
        ('<damper joint="hip" kv="5" ctrlrange="0 1"/>', 0.0),
    ],
)
def test_servos_hold_their_position_and_other_actuators_get_zero(actuator, control):
    assert brake_control(actuator, [0.7, 0.0], [2.0, 0.0]) == [pytest.approx(control)]


def test_a_brake_stays_within_the_range_of_the_control():
    actuator = '<motor joint="hip" ctrlrange="-0.1 0.1" ctrllimited="true"/>'
    assert brake_control(actuator, [0.0, 0.0], [9.0, 0.0]) == [-0.1]


def test_a_model_without_actuators_has_nothing_to_brake():
    assert brake_control("", [0.0, 0.0], [9.0, 0.0]) == []
