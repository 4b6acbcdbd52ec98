"""Steps of a model: state, sensors, control, and divergence."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from obelisk_py.core.sim.mujoco.control import ControlInbox
from obelisk_py.core.sim.mujoco.loading import compile_model, load_spec
from obelisk_py.core.sim.mujoco.simulation import DivergenceError, Simulation

pytestmark = pytest.mark.mujoco

_ACCELERATIONS = ("acc", "toe_force", "hip_force", "sole_touch")
"""Sensors that depend on the control."""
INTEGRATORS = ["EULER", "IMPLICIT", "IMPLICITFAST", "RK4"]


def _with_integrator(model, name):
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{name}")
    return model


def _simulation(model):
    inbox = ControlInbox(field="u", size=model.nu, monotonic_s=lambda: 0.0)
    return Simulation(model, inbox), inbox


def _command(inbox, values):
    assert inbox.offer(SimpleNamespace(u=values))


def _controls(model, step):
    return np.sin(0.01 * step + np.arange(model.nu))


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_trajectory_is_identical_to_that_of_mj_step(everything, integrator):
    model = _with_integrator(everything, integrator)
    simulation, inbox = _simulation(model)
    simulation.reset(None)
    data = mujoco.MjData(model)
    for step in range(1_500):
        data.ctrl[:] = _controls(model, step)
        mujoco.mj_step(model, data)
        _command(inbox, _controls(model, step))
        simulation.advance()
    assert data.ncon > 0, "contacts are part of the comparison"
    assert simulation.data.qpos.tobytes() == data.qpos.tobytes()
    assert simulation.data.qvel.tobytes() == data.qvel.tobytes()
    assert simulation.data.time == data.time


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_steps_taken_together_are_those_taken_one_by_one(everything, integrator):
    model = _with_integrator(everything, integrator)
    one, _ = _simulation(model)
    many, _ = _simulation(model)
    one.reset(None)
    many.reset(None)
    for _ in range(96):
        one.advance()
    for _ in range(6):
        many.advance(16)
    assert many.steps == one.steps == 96
    assert many.data.qpos.tobytes() == one.data.qpos.tobytes()
    assert many.data.sensordata.tobytes() == one.data.sensordata.tobytes()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_sensors_belong_to_the_state_that_was_reached(everything, integrator):
    model = _with_integrator(everything, integrator)
    simulation, inbox = _simulation(model)
    simulation.reset(None)
    replay = mujoco.MjData(model)
    for step in range(300):
        _command(inbox, _controls(model, step))
        replay.ctrl[:] = _controls(model, step)
        mujoco.mj_step(model, replay)
        simulation.advance()
    over_the_step = {name: replay.sensor(name).data.copy() for name in _ACCELERATIONS}
    mujoco.mj_forward(model, replay)
    for number in range(model.nsensor):
        name = model.sensor(number).name
        wanted = over_the_step.get(name, replay.sensor(name).data)
        assert np.abs(simulation.data.sensor(name).data - wanted).max() <= 1e-12, name


def test_a_reset_goes_to_the_keyframe_with_its_control(dummy):
    simulation, inbox = _simulation(dummy)
    _command(inbox, [1.0])
    simulation.reset("other")
    assert simulation.data.qpos.tolist() == [-1.0]
    assert simulation.data.ctrl.tolist() == [-1.0]
    assert simulation.data.sensor("joint_pos").data.tolist() == [-1.0]
    simulation.advance()
    assert simulation.data.ctrl.tolist() == [-1.0], "a control from before the reset is forgotten"


def test_without_a_keyframe_a_reset_restores_the_models_default(dummy):
    simulation, _ = _simulation(dummy)
    simulation.reset("other")
    simulation.advance(10)
    simulation.reset(None)
    assert (simulation.steps, simulation.data.time) == (0, 0.0)
    assert simulation.data.qpos.tolist() == [0.0]


def test_after_a_hundred_thousand_steps_the_time_is_exact_unlike_that_of_mujoco(dummy):
    dummy.opt.timestep = 0.007
    simulation, _ = _simulation(dummy)
    simulation.reset("ic")
    simulation.advance(100_000)
    assert simulation.time_ns == 700_000_000_000
    assert round(simulation.data.time * 1e9) != simulation.time_ns
    simulation.reset("ic")
    assert simulation.time_ns == 0


def test_time_begins_at_that_of_the_keyframe():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><keyframe><key name='later' time='2.5'/></keyframe></mujoco>"
    )
    simulation, _ = _simulation(model)
    simulation.reset("later")
    assert simulation.time_ns == 2_500_000_000
    simulation.advance(2)
    assert simulation.time_ns == 2_504_000_000


def test_a_control_acts_on_the_next_step_until_a_newer_one_arrives(everything):
    simulation, inbox = _simulation(everything)
    simulation.reset(None)
    simulation.advance()
    assert simulation.data.ctrl.tolist() == [0.0, 0.0]
    _command(inbox, [0.5, -0.5])
    simulation.advance()
    assert simulation.data.actuator_force.tolist() == [0.5, -0.5]
    simulation.advance()
    assert simulation.data.ctrl.tolist() == [0.5, -0.5]


def test_two_runs_with_the_same_controls_are_identical(dummy):
    def run():
        simulation, inbox = _simulation(dummy)
        simulation.reset("ic")
        trajectory = []
        for step in range(500):
            _command(inbox, [np.sin(step * 0.01)])
            simulation.advance()
            trajectory.append(simulation.data.qpos.tobytes())
        return trajectory

    assert run() == run()


def test_the_dummy_follows_a_sine_closely(dummy):
    simulation, inbox = _simulation(dummy)
    simulation.reset("ic")
    commands, positions = [], []
    for step in range(10_000):
        commands.append(np.sin(step * 0.001))
        _command(inbox, commands[-1:])
        simulation.advance()
        positions.append(simulation.data.qpos[0])
    assert np.corrcoef(commands[2_000:], positions[2_000:])[0, 1] > 0.999


@pytest.mark.parametrize("entry", ["qpos", "qvel"])
def test_a_state_that_is_not_finite_names_the_time_the_joint_and_the_body(
    everything_xml, entry, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    model = compile_model(load_spec(everything_xml), None)
    simulation, _ = _simulation(model)
    simulation.reset(None)
    simulation.advance(5)
    address = model.jnt_dofadr if entry == "qvel" else model.jnt_qposadr
    hip = model.joint("right_hip").id
    getattr(simulation.data, entry)[address[hip]] = np.nan
    mujoco.mj_forward(model, simulation.data)
    with pytest.raises(DivergenceError) as caught:
        simulation.advance()
    text = str(caught.value)
    assert text.startswith("the simulation diverged at 0.0120 s: the ")
    assert "of joint `" in text
    assert "is NaN, infinite or beyond 1e10" in text
    assert not np.isfinite(simulation.data.qpos).all(), "the state is kept to be looked at"


def test_a_divergence_names_the_joint_that_did_it(dummy_xml, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    model = compile_model(load_spec(dummy_xml), None)
    simulation, _ = _simulation(model)
    simulation.reset("ic")
    simulation.data.qvel[0] = 1e12
    with pytest.raises(DivergenceError, match="of joint `joint1` of body `link1`"):
        simulation.advance()
