"""The simulator in lockstep: its services, old commands, pushes and restarts."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from obelisk_control_msgs.msg import PositionSetpoint
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool

from obelisk_py.core.lockstep.scheduler import LockstepError
from obelisk_py.core.sim.mujoco import ObeliskMujocoRobot
from obk_testing.trial import StackTrial

from .world import World

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

EXAMPLES = Path(__file__).parents[2] / "examples"
DUMMY = EXAMPLES / "dummy" / "dummy_new.yaml"
ARM = EXAMPLES / "arm" / "arm.yaml"
CARTPOLE = EXAMPLES / "cartpole" / "cartpole.yaml"
ROBOT = "/obelisk_robot_0"

Start = Callable[..., StackTrial]


def _controls(trial: StackTrial) -> list[float]:
    """The controls of the actuators."""
    controls: list[float] = trial.nodes[ROBOT].mj_data.ctrl.tolist()
    return controls


def test_pause_step_and_reset(start_config: Start) -> None:
    trial = start_config(DUMMY)
    begin = trial.run(0.001).qpos[0]
    trial.run(0.199)
    assert trial.call(f"{ROBOT}/pause", SetBool.Request(data=True)).success
    steps = len(set(trial.run(0.1).qpos[:, 0].tolist()))
    trial.run(0.1)
    assert len(set(trial.result().qpos[:, 0].tolist())) == steps
    trial.call(f"{ROBOT}/step")
    assert len(set(trial.run(0.01).qpos[:, 0].tolist())) == steps + 1
    assert trial.call(f"{ROBOT}/pause", SetBool.Request(data=False)).success
    trial.run(0.1)
    assert trial.call(f"{ROBOT}/reset").success
    run = trial.run(0.001)
    np.testing.assert_allclose(run.qpos[-1], begin, atol=1e-3)
    assert not run.faults


def test_an_unpublished_topic_is_not_read_as_empty(start_config: Start) -> None:
    run = start_config(ARM).run(0.1)
    for read in (lambda log: log.forces, lambda log: log.at(0.1), lambda log: log.stamps):
        with pytest.raises(LookupError, match=r"watch=\['/arm/wrist_force'\]"):
            read(run["/arm/wrist_force"])
    assert run.digest() == start_config(ARM).run(0.1).digest()
    watched = start_config(ARM, watch=["/arm/wrist_force"]).run(0.1)
    assert len(watched["/arm/wrist_force"].t) > 0


def test_topics_to_watch_and_record_exist(start_config: Start) -> None:
    for options in ({"watch": ["/arm/wrist_forse"]}, {"record": ["/arm/ets"]}):
        with pytest.raises(LookupError, match="did you mean"):
            start_config(ARM, **options)
    for options in ({"watch": "/arm/wrist_force"}, {"record": "/arm/est"}):
        with pytest.raises(TypeError):
            start_config(ARM, **options)
    start_config(ARM, watch=["/arm/wrist_force"], record=["/arm/wrist_force"])


@pytest.mark.parametrize("action", ["hold", "zero", "damp"])
def test_old_commands_are_acted_on_at_the_step_after_the_deadline(
    start_config: Start, action: str
) -> None:
    settings = ("max_age_sec=0.05", f"stale_action={action}")
    trial = start_config(DUMMY, *(f"robot.subscribers[0].{each}" for each in settings))
    trial.run(0.5)
    trial.kill("control")
    trial.run(0.05)
    last = _controls(trial)
    trial.run(0.003)
    after = _controls(trial)
    assert last != [0.0]
    if action == "zero":
        assert after == [0.0]
    elif action == "hold":
        assert after == last
    else:  # a position servo holds its last position
        np.testing.assert_allclose(after, trial.nodes[ROBOT].mj_data.qpos, atol=0.01)
    run = trial.run(1.0)
    assert any(entry.severity >= 30 and "0.5" in entry.text for entry in run.log)


class OwnCommands(ObeliskMujocoRobot):
    """Computes the controls itself."""

    def apply_control(self, control_msg: Any) -> None:
        self._set_shared_ctrl(control_msg.u_mujoco)


class Doubled(ObeliskMujocoRobot):
    """Passes on another message, and ignores whether it is accepted."""

    def apply_control(self, control_msg: Any) -> None:
        super().apply_control(PositionSetpoint(u_mujoco=[2 * u for u in control_msg.u_mujoco]))


@pytest.mark.parametrize("robot_class", [OwnCommands, Doubled])
def test_commands_that_a_subclass_lets_be_rejected_do_not_count(
    world: World, robot_class: type[ObeliskMujocoRobot]
) -> None:
    model = EXAMPLES / "cartpole" / "model" / "cartpole.xml"
    command = "topic: /ctrl, msg_type: PositionSetpoint, max_age_sec: 0.1, stale_action: zero"
    settings = [
        Parameter("mujoco_setting", value=f"{{model_xml_path: {model}}}"),
        Parameter("sub_ctrl_setting", value=f"{{{command}}}"),
    ]
    robot = world.node(
        "robot",
        lambda name: robot_class(name, PositionSetpoint, parameter_overrides=settings),
    )
    sender = world.node("sender")
    publisher = sender.create_publisher(PositionSetpoint, "/ctrl", 10)

    def publish() -> None:
        publisher.publish(PositionSetpoint(u_mujoco=[1.0 if world.t < 0.2 else math.nan]))

    sender.create_timer(0.01, publish)
    world.run(0.25)
    assert robot.mj_data.ctrl[0] > 0.0
    world.run(0.25)
    assert robot.mj_data.ctrl[0] == 0.0
    reports = [text for text in world.log if "control rejected" in text]
    assert reports
    assert not any("returned False" in text for text in reports)


def test_noise_is_added_to_nested_fields_and_messages_of_floats(start_config: Start) -> None:
    imu = "/obelisk/dummy/imu"

    def measured(*fields: str) -> Any:
        trial = start_config(DUMMY, watch=[imu])
        for field in fields:
            trial.noise(imu, field, 0.1)
        return trial.run(0.1)[imu]

    ideal = measured()
    noisy = measured("linear_acceleration", "angular_velocity.x")
    changed = np.asarray(noisy.linear_acceleration) - np.asarray(ideal.linear_acceleration)
    assert (np.abs(changed) > 0.0).all()
    assert changed.std() == pytest.approx(0.1, rel=0.3)
    assert (noisy.angular_velocity.x != ideal.angular_velocity.x).all()
    assert (noisy.angular_velocity.y == ideal.angular_velocity.y).all()
    for field in ("header", "header.stamp.sec", "linear_acceleration.w", "x.y", ""):
        with pytest.raises(LookupError):
            measured(field)


def test_rejecting_every_command_until_now_is_a_fault(start_config: Start) -> None:
    trial = start_config(CARTPOLE, without=("control",))
    topic = trial.stack.plan.nodes[-1].subscribes[0].topic

    def publish(*controls: float) -> None:
        trial.publish(topic, PositionSetpoint(u_mujoco=controls))

    for tenth in range(20):
        trial.at(0.1 * tenth, lambda: publish(0.0, 0.0))
    assert not trial.run(0.95).faults
    (fault,) = trial.run(1.0).faults
    assert ROBOT in fault
    publish(0.0)
    assert not trial.run(0.1).faults


def test_parameters_are_checked_as_in_requests_of_other_processes(start_config: Start) -> None:
    trial = start_config(ARM, parameters={"control": {"move_s": 3}})
    control = trial.nodes["/obelisk_control_0"]
    assert (control.move_s, type(control.move_s)) == (3.0, float)
    for value in (-1.0, math.nan, "fast"):
        with pytest.raises(LockstepError, match="rejects `move_s`"):
            trial.set_parameter("control", "move_s", value)
    with pytest.raises(LockstepError, match="rejects `move_s`"):
        start_config(ARM, parameters={"control": {"move_s": -1.0}})
    assert control.move_s == 3.0


def test_the_next_activation_uses_the_new_keyframe(start_config: Start) -> None:
    trial = start_config(DUMMY, without=("control",))
    robot = trial.nodes[ROBOT]
    other = robot.mj_model.key("other").qpos
    trial.set_parameter("robot", "ic_keyframe", "other")
    assert trial.run(0.01).qpos[-1] != pytest.approx(other, abs=0.05)
    trial.at(trial.t, lambda: (robot.trigger_deactivate(), robot.trigger_activate()))
    assert trial.run(0.003).qpos[-1] == pytest.approx(other, abs=0.05)


def test_a_restarted_simulator_steps_on(start_config: Start) -> None:
    trial = start_config(DUMMY)
    trial.run(0.2)
    trial.restart("robot", after=0.1)
    run = trial.run(0.3)
    assert not run.faults
    np.testing.assert_allclose(run.t[[199, 200]], [0.2, 0.301], atol=1e-9)
    assert run.t[-1] == pytest.approx(0.5)
    assert run.qpos[200, 0] == pytest.approx(0.5, abs=0.01)  # the keyframe
    trial.push("link1", [200.0, 0.0, 0.0], duration=0.01)
    before = run.qvel[-1, 0]
    assert abs(trial.run(0.01).qvel[-1, 0] - before) > 0.1


def test_a_frozen_simulator_skips_the_time(start_config: Start) -> None:
    trial = start_config(DUMMY)
    trial.run(0.1)
    trial.freeze("robot", 0.1)
    run = trial.run(0.2)
    assert not ((run.t > 0.1005) & (run.t < 0.1995)).any()
    assert run.t[-1] == pytest.approx(0.3)


def test_a_push_lasts_as_long_as_it_should(start_config: Start) -> None:
    trial, still = start_config(ARM), start_config(ARM)
    for each in (trial, still):
        each.run(0.1)
    trial.push("forearm", [0.0, 50.0, 0.0], duration=0.02)
    pushed, plain = trial.run(0.1), still.run(0.1)
    first = int(np.flatnonzero((pushed.qpos != plain.qpos).any(axis=1))[0])
    assert pushed.t[first] == pytest.approx(0.1, abs=0.003)
    data: Any = trial.nodes[ROBOT].mj_data
    assert not data.xfrc_applied.any()
    with pytest.raises(LookupError, match="forearm"):
        trial.push("forarm", [1.0, 0.0, 0.0], duration=0.1)


def test_a_push_may_last_until_the_end(start_config: Start) -> None:
    trials = [start_config(CARTPOLE) for _ in range(2)]
    for trial, duration in zip(trials, (math.inf, 0.2), strict=True):
        trial.push("cart", [5.0, 0.0, 0.0], duration=duration)
    endless, finite = (trial.run(0.2) for trial in trials)
    assert endless.first_difference(finite) is None


def test_a_killed_robot_cannot_be_pushed(start_config: Start) -> None:
    trial = start_config(CARTPOLE)
    trial.kill("robot")
    with pytest.raises(LookupError, match=f"{ROBOT} was killed"):
        trial.push("cart", [5.0, 0.0, 0.0], duration=0.1)


def test_a_push_shorter_than_a_step_lasts_one_step(start_config: Start) -> None:
    trial = start_config(CARTPOLE, without=("control",))
    step_s = trial.nodes[ROBOT].mj_model.opt.timestep
    velocities = []
    for duration in (0.1 * step_s, step_s):
        before = trial.run(0.1).qvel[-1][0]
        trial.push("cart", [100.0, 0.0, 0.0], duration=duration)
        velocities.append(trial.run(step_s).qvel[-1][0] - before)
    assert velocities[0] > 0.01
    assert velocities[0] == pytest.approx(velocities[1], rel=0.1)


TWO = """
config: two
robot:
  - &cart
    is_simulated: true
    pkg: obelisk_sim_py
    executable: obelisk_mujoco_robot
    subscribers: [{{key: sub_ctrl, topic: /a/ctrl, msg_type: PositionSetpoint}}]
    sim: {{model_xml_path: {model}}}
  - {{<<: *cart, subscribers: [{{key: sub_ctrl, topic: /b/ctrl, msg_type: PositionSetpoint}}]}}
"""


def test_a_push_and_a_mass_concern_one_of_several_robots(
    start_config: Start, tmp_path: Path
) -> None:
    (tmp_path / "two.yaml").write_text(TWO.format(model=EXAMPLES / "cartpole/model/cartpole.xml"))
    trial = start_config(tmp_path / "two.yaml")
    robots = [trial.nodes[name] for name in sorted(trial.nodes)]
    with pytest.raises(LookupError, match="robot="):
        trial.push("cart", [50.0, 0.0, 0.0], duration=0.05)
    trial.push("cart", [50.0, 0.0, 0.0], duration=0.05, robot="/obelisk_robot_1")
    trial.scale_mass("pole", 2.0, robot="/obelisk_robot_1")
    trial.run(0.04)
    velocities = [robot.mj_data.qvel[0] for robot in robots]
    assert velocities[0] == pytest.approx(0.0, abs=1e-3)
    assert velocities[1] > 0.5
    trial.run(0.04)
    assert not any(robot.mj_data.xfrc_applied.any() for robot in robots)
    masses = [robot.mj_model.body("pole").mass[0] for robot in robots]
    assert masses[1] == pytest.approx(2 * masses[0])


def test_a_new_activation_scales_no_mass_again(start_config: Start) -> None:
    trial = start_config(CARTPOLE)
    robot = trial.nodes[ROBOT]
    trial.scale_mass("cart", 2.0)
    mass = robot.mj_model.body("cart").mass[0]
    trial.at(trial.t, lambda: (robot.trigger_deactivate(), robot.trigger_activate()))
    trial.run(0.01)
    assert robot.mj_model.body("cart").mass[0] == mass


def test_the_noise_of_sensors_has_the_seed(start_config: Start) -> None:
    runs = [start_config(ARM, seed=seed).run(0.05) for seed in (0, 0, 1)]
    readings = [np.array([m.joint_pos for m in run["/arm/encoders"].messages]) for run in runs]
    assert (readings[0] == readings[1]).all()
    assert (readings[0] != readings[2]).any()


def test_a_heavier_body_accelerates_less_also_after_a_restart(start_config: Start) -> None:
    masses = []
    for factor in (1.0, 4.0):
        trial = start_config(CARTPOLE, without=("control",))
        trial.scale_mass("cart", factor)
        masses.append(trial.nodes[ROBOT].mj_model.body_mass[1])
        trial.push("cart", [10.0, 0.0, 0.0], duration=0.05)
        masses.append(1.0 / trial.run(0.05).qvel[-1][0])
        trial.restart("robot")
        trial.run(0.01)
        masses.append(trial.nodes[ROBOT].mj_model.body_mass[1])
    nominal, heavy = np.array(masses).reshape(2, 3)
    assert heavy / nominal == pytest.approx([4.0, 3.7, 4.0], abs=0.5)


def test_only_bodies_of_the_model_have_a_mass(start_config: Start) -> None:
    trial = start_config(CARTPOLE)
    with pytest.raises(LookupError, match="pole"):
        trial.scale_mass("pol", 2.0)
    with pytest.raises(ValueError, match="above 0"):
        trial.scale_mass("pole", 0.0)
