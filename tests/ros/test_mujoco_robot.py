"""The simulator as a node on the real rclpy: subscriptions, publishers, faults."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, ClassVar

import mujoco
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import GetState
from obelisk_control_msgs.msg import PositionSetpoint, VelocityCommand
from obelisk_sensor_msgs.msg import JointEncoders, ObkImage, ObkImu, ObkScan, TrueSimState
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

from obelisk_py.core.exceptions import ObeliskError
from obelisk_py.core.sim.mujoco import ObeliskMujocoRobot
from obelisk_py.core.sim.mujoco.viewers import processes
from obelisk_spec.components import format_setting

from .stack import DEADLINE_S, DUMMY, eventually, parameters, request, spinning

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

ENCODERS = {
    "topic": "/joint_encoders",
    "dt": 0.001,
    "msg_type": "JointEncoders",
    "sensor_names": {"joint_pos": "jointpos", "joint_vel": "jointvel"},
}
IMU = {
    "topic": "/imu",
    "dt": 0.004,
    "msg_type": "ObkImu",
    "sensor_names": {"tip_acc_sensor": "accelerometer"},
}
HEIGHTS = {
    "topic": "/heights",
    "dt": 0.02,
    "msg_type": "ObkScan",
    "scan_config": {
        "site_name": "post",
        "pattern": {"type": "height_scan", "resolution": 0.5, "size": [1.0, 1.0]},
    },
}
PICTURES = {
    "topic": "/pictures",
    "dt": 0.05,
    "msg_type": "ObkImage",
    "sensor_names": {"above": "camera"},
}
SEEING = """
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <site name="post" pos="0 0 1"/>
    <camera name="above" pos="0 0 2" resolution="8 6"/>
    <body pos="3 0 1"><joint name="elbow"/><geom size="0.1"/></body>
  </worldbody>
  <actuator><motor joint="elbow"/></actuator>
</mujoco>
"""
BLOCK = {
    "model_xml_path": str(DUMMY.with_name("dummy.xml")),
    "sensor_settings": [ENCODERS, IMU],
    "viz_geoms": {"dt": 0.05, "dummy_box": "box"},
}
UNSTABLE = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <body name="arm"><joint name="elbow" stiffness="1e8"/><geom size="0.1" pos="0 0.1 0"/></body>
  </worldbody>
  <actuator><motor joint="elbow"/></actuator>
  <keyframe><key name="ic" qpos="1"/></keyframe>
</mujoco>
"""


@contextmanager
def simulator(
    block: dict[str, Any] | None = None,
    robot: type[ObeliskMujocoRobot] = ObeliskMujocoRobot,
    *words: Any,
    **settings: Any,
) -> Iterator[tuple[ObeliskMujocoRobot, Callable[[type[Any], str], list[Any]]]]:
    """A simulator, and a function that collects the messages on a topic."""
    wired = {
        "mujoco_setting": format_setting(BLOCK if block is None else block),
        "sub_ctrl_setting": "{topic: /ctrl, msg_type: PositionSetpoint}",
        "pub_true_sim_state_setting": "{topic: /true}",
        "timer_true_sim_state_setting": "{timer_period_sec: 0.01}",
        **settings,
    }

    def make() -> ObeliskMujocoRobot:
        return robot("sim", *words, **parameters(**wired))

    with spinning(make) as node:

        def collect(message_type: type[Any], topic: str) -> list[Any]:
            received: list[Any] = []
            node.create_subscription(message_type, topic, received.append, QoSProfile(depth=1000))
            return received

        yield node, collect


def test_a_timer_of_the_true_state_without_its_publisher_is_reported_at_configure() -> None:
    with simulator(pub_true_sim_state_setting="") as (node, _):
        assert not request(node, "configure")
        assert node.last_fault.text.startswith(
            "the config sets `timer_true_sim_state`, but not its publisher `pub_true_sim_state`"
        )


def test_a_publisher_of_the_true_state_without_its_timer_is_reported_at_configure() -> None:
    with simulator(timer_true_sim_state_setting="") as (node, _):
        reported: list[str] = []
        node.get_logger().warning = reported.append
        assert request(node, "configure")
        assert ["`pub_true_sim_state`" in line for line in reported] == [True]


def test_it_publishes_while_it_is_active_and_only_then() -> None:
    with simulator() as (node, collect):
        encoders, imu = collect(JointEncoders, "/joint_encoders"), collect(ObkImu, "/imu")
        true, rtf = collect(TrueSimState, "/true"), collect(Float64, "/sim/rtf")
        markers = collect(MarkerArray, "/sim/viz_geoms")
        same_markers = collect(MarkerArray, "/obelisk/sim/mujoco_scene_viz")
        assert request(node, "configure")
        assert encoders == []
        for _ in range(2):
            received = (encoders, imu, true, rtf, markers, same_markers)
            for messages in received:
                messages.clear()
            assert request(node, "activate")
            for messages in received:
                eventually(lambda messages=messages: messages, "a message of each kind")
            assert request(node, "deactivate")
        assert len(encoders[0].y) == 2
        assert imu[0].header.frame_id == "tip"
        assert true[0].joint_names == ["joint1"]
        assert markers[0].markers[0].scale.x == 0.9
        assert request(node, "cleanup")
        assert request(node, "configure")


def test_every_finding_about_the_block_is_reported_and_a_corrected_block_is_accepted() -> None:
    bad = {**BLOCK, "sensor_settings": [{**ENCODERS, "sensor_names": {"joint_pso": "jointpos"}}]}
    with simulator(bad, ic_keyframe="stand") as (node, _):
        assert not request(node, "configure")
        assert node.state_label == "unconfigured"
        assert node.last_fault is not None
        assert "sensor `joint_pso`" in node.last_fault.text
        assert "keyframe `stand`" in node.last_fault.text
        node.set_parameters(
            parameters(mujoco_setting=format_setting(BLOCK), ic_keyframe="ic")[
                "parameter_overrides"
            ]
        )
        assert request(node, "configure")


def test_rays_and_pictures_are_published_or_their_absence_is_explained(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "seeing.xml").write_text(SEEING)
    block = {"model_xml_path": str(tmp_path / "seeing.xml"), "sensor_settings": [HEIGHTS, PICTURES]}
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    with simulator(block) as (node, collect):
        heights, pictures = collect(ObkScan, "/heights"), collect(ObkImage, "/pictures")
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert (
            "/pictures: camera `above`: MUJOCO_GL is `glfw`, which cannot render off-screen"
            in node.last_fault.text
        )
        monkeypatch.delenv("MUJOCO_GL")
        if not request(node, "configure"):
            assert "cameras need OpenGL, and " in node.last_fault.text
            return
        assert request(node, "activate")
        eventually(lambda: len(heights) > 3 and len(pictures) > 3, "scans and pictures")
        assert list(heights[0].data) == [0.0] * 9, "the z of the ground"
        assert len(pictures[0].y.data) == 8 * 6 * 3
        assert request(node, "deactivate")
        assert request(node, "cleanup")
        assert not [thread for thread in threading.enumerate() if "camera" in thread.name]


class _VelocityRobot(ObeliskMujocoRobot):
    """Computes the actuators' controls from a message that the simulator cannot read."""

    def apply_control(self, control_msg: Any) -> None:
        self._set_shared_ctrl([control_msg.v_x])


class _TranslatingRobot(ObeliskMujocoRobot):
    """Converts its own message type to one that the simulator reads."""

    def apply_control(self, control_msg: Any) -> bool:
        return super().apply_control(PositionSetpoint(u_mujoco=[control_msg.v_x]))


class _EndlessRobot(_VelocityRobot):
    """Runs its own loop and never reads `simulator_stop`, like existing simulators."""

    n_u = 1

    def run_simulator(self) -> None:
        while True:
            with self.lock:
                self.mj_data.ctrl[:] = self.shared_ctrl
            mujoco.mj_step(self.mj_model, self.mj_data)
            time.sleep(0.001)


class _SteppingRobot(_VelocityRobot):
    """Run the loop."""

    def run_simulator(self) -> None:
        stop = self.simulator_stop
        while not stop.wait(0.001):
            self.mj_data.ctrl[:] = self.shared_ctrl
            mujoco.mj_step(self.mj_model, self.mj_data)


@pytest.mark.parametrize(
    "robot", [_VelocityRobot, _TranslatingRobot, _SteppingRobot, _EndlessRobot]
)
def test_an_inheriting_robot_reads_its_own_control_messages(
    robot: type[ObeliskMujocoRobot],
) -> None:
    with simulator(None, robot, VelocityCommand, sub_ctrl_setting="topic:/ctrl") as (node, _):
        with pytest.raises(ObeliskError, match="only while it is configured"):
            _ = node.mj_model
        assert request(node, "configure")
        assert request(node, "activate")
        assert node.mj_model.nu == 1
        eventually(lambda: node.mj_data.time > 0.0, "the first step")
        assert list(node.shared_ctrl) == [0.5], "the control of the keyframe"
        control = node.create_publisher(VelocityCommand, "/ctrl", 10)
        eventually(lambda: control.get_subscription_count() == 1, "the subscription")
        for number in (0.25, float("nan")):
            control.publish(VelocityCommand(v_x=number))
        eventually(lambda: node.mj_data.ctrl[0] == 0.25, "the control")
        eventually(lambda: node.mj_data.time > 0.01, "steps")
        assert list(node.shared_ctrl) == [0.25]
        assert request(node, "deactivate")


def test_a_run_starts_from_the_keyframe_with_its_control() -> None:
    with simulator(ic_keyframe="other") as (node, collect):
        encoders = collect(JointEncoders, "/joint_encoders")
        assert request(node, "configure")
        assert request(node, "activate")
        eventually(lambda: len(encoders) > 50, "joint encoders")
        assert all(message.y[0] == pytest.approx(-1.0, abs=0.02) for message in encoders)


def test_a_valid_control_is_followed_and_an_invalid_one_is_not() -> None:
    with simulator() as (node, collect):
        encoders = collect(JointEncoders, "/joint_encoders")
        control = node.create_publisher(PositionSetpoint, "/ctrl", 10)
        assert request(node, "configure")
        assert request(node, "activate")
        eventually(lambda: control.get_subscription_count(), "the subscription of the simulator")
        control.publish(PositionSetpoint(u_mujoco=[0.25]))
        control.publish(PositionSetpoint(u_mujoco=[1.0, 1.0]))
        control.publish(PositionSetpoint(u_mujoco=[float("nan")]))
        control.publish(PositionSetpoint())
        settled = pytest.approx([0.25, 0.0], abs=0.02)
        eventually(lambda: encoders and list(encoders[-1].y) == settled, "the joint at 0.25")
        assert node.state_label == "active"


def _asked(node: Any, kind: type[Any], name: str, **fields: Any) -> Any:
    client = node.create_client(kind, f"~/{name}")
    eventually(client.service_is_ready, f"the service {name}")
    answer = client.call_async(kind.Request(**fields))
    eventually(answer.done, f"the answer of {name}")
    node.destroy_client(client)
    return answer.result()


def test_it_pauses_steps_and_resets() -> None:
    with simulator(use_sim_time=True) as (node, collect):
        clock = collect(Clock, "/clock")
        assert request(node, "configure")
        assert _asked(node, Trigger, "reset").message == "the simulator is not active"
        assert request(node, "activate")
        eventually(lambda: len(clock) > 20, "the clock")
        assert not _asked(node, Trigger, "step").success
        assert _asked(node, SetBool, "pause", data=True).success
        before = _asked(node, Trigger, "step").message
        after = _asked(node, Trigger, "step").message
        seconds = [float(text.removeprefix("at ").removesuffix(" s")) for text in (before, after)]
        assert seconds[1] - seconds[0] == pytest.approx(0.001, abs=1e-9)
        eventually(lambda: _seconds(clock[-1]) == pytest.approx(seconds[1]), "the last step")
        assert _asked(node, Trigger, "reset").message == "at ic"
        eventually(lambda: _seconds(clock[-1]) == 0.0, "the clock, set back")
        (refused,) = node.set_parameters(parameters(ic_keyframe="stand")["parameter_overrides"])
        assert refused.reason == (
            "the keyframe `stand` is not in the model; available: `ic`, `other`"
        )
        assert _asked(node, Trigger, "reset").message == "at ic"
        node.set_parameters(parameters(ic_keyframe="other")["parameter_overrides"])
        assert _asked(node, Trigger, "reset").message == "at other"
        assert _asked(node, Trigger, "step").message == "at 0.001 s"
        eventually(lambda: _seconds(clock[-1]) == pytest.approx(0.001), "the first step")
        assert _asked(node, SetBool, "pause", data=False).message == "running"
        eventually(lambda: _seconds(clock[-1]) > 0.05, "the clock")
        assert _asked(node, SetBool, "pause", data=True).success
        assert request(node, "deactivate")
        received = len(clock)
        assert request(node, "activate")
        eventually(lambda: len(clock) > received + 20, "the clock of the next run")


class _Viewer:
    """Stores the times of the states that it receives."""

    def __init__(self, _kind: str, _arguments: Any, _model: Any, data: Any, **_options: Any):
        self.times: list[float] = []
        self.states = self
        self._data = data
        self.made.append(self)

    made: ClassVar[list["_Viewer"]] = []

    def send(self) -> None:
        self.times.append(self._data.time)

    def close(self) -> None: ...


def test_a_reset_is_visible_while_the_simulation_is_paused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "ViewerProcess", _Viewer)
    with simulator(viewer="web") as (node, _):
        assert request(node, "configure")
        times = _Viewer.made.pop().times
        assert request(node, "activate")
        eventually(lambda: len(times) > 3, "states")
        assert _asked(node, SetBool, "pause", data=True).success
        assert times[-1] > 0.0
        assert _asked(node, Trigger, "reset").success
        assert times[-1] == 0.0


def _seconds(message: Clock) -> float:
    return float(message.clock.sec + message.clock.nanosec * 1e-9)


def test_with_simulation_time_stamps_are_that_time_and_the_clock_reports_it() -> None:
    with simulator(use_sim_time=True) as (node, collect):
        encoders, clock = collect(JointEncoders, "/joint_encoders"), collect(Clock, "/clock")
        assert request(node, "configure")
        assert request(node, "activate")
        eventually(lambda: len(encoders) > 20 and len(clock) > 21, "sensors and clock")
        assert request(node, "deactivate")
        stamps = [message.header.stamp.nanosec for message in encoders[:20]]
        assert stamps == [1_000_000 * step for step in range(1, 21)]
        assert [message.clock.nanosec for message in clock[:21]] == [0, *stamps]


def test_a_simulation_that_diverges_takes_the_node_to_error_processing(tmp_path: Any) -> None:
    path = tmp_path / "unstable.xml"
    path.write_text(UNSTABLE)
    with simulator({"model_xml_path": str(path)}) as (node, _):
        assert request(node, "configure")
        assert request(node, "activate")
        eventually(lambda: node.state_label == "unconfigured", "error processing")
        assert node.last_fault is not None
        assert "diverged at" in str(node.last_fault)
        assert "`elbow` of body `arm`" in str(node.last_fault)
        assert "Traceback" not in str(node.last_fault)


@pytest.mark.parametrize("factor", [0, 0.0, 5, 0.5])
def test_any_number_above_or_at_zero_is_a_realtime_factor(factor: float) -> None:
    with simulator(realtime_factor=factor) as (node, collect):
        encoders = collect(JointEncoders, "/joint_encoders")
        assert request(node, "configure")
        assert request(node, "activate")
        eventually(lambda: encoders, "joint encoders")


@pytest.mark.parametrize("factor", [-1.0, "fast", True, float("nan")])
def test_anything_else_is_rejected(factor: Any) -> None:
    with simulator(realtime_factor=factor) as (node, _):
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert "parameter `realtime_factor`" in node.last_fault.text


def set_factor(node: Any, factor: float) -> Any:
    (result,) = node.set_parameters(parameters(realtime_factor=factor)["parameter_overrides"])
    return result


def test_a_realtime_factor_takes_effect_at_once_and_changes_the_expected_rate() -> None:
    with simulator() as (node, collect):
        rtf = collect(Float64, "/sim/rtf")
        assert request(node, "configure")
        assert request(node, "activate")
        eventually(lambda: rtf, "the factor that is reached")
        assert set_factor(node, 0.25).successful
        rtf.clear()
        eventually(lambda: rtf and rtf[-1].data < 0.3, "the new factor")
        reported = collect(DiagnosticArray, "/diagnostics")
        eventually(lambda: realtime_factors(reported), "the factor among the diagnostics")
        assert 0 < realtime_factors(reported)[0] < 0.3
        expected = [
            float(pair.value)
            for status in reported[-1].status
            if status.name.endswith(": steps")
            for pair in status.values
            if pair.key == "expected_hz"
        ]
        assert expected == [250.0]
        refused = set_factor(node, 0.0)
        assert not refused.successful
        assert "clean up, set it, configure again" in refused.reason
        assert not set_factor(node, -1.0).successful
        assert node.get_parameter("realtime_factor").value == 0.25
        assert request(node, "deactivate")
        assert request(node, "cleanup")
        assert set_factor(node, 0.0).successful


def test_a_viewer_pauses_steps_resets_and_changes_the_speed() -> None:
    with simulator(realtime_factor=1) as (node, _):
        assert request(node, "configure")
        controls = node._viewer_host(node._simulation).controls
        assert not controls.answer('{"request": "pause", "is_paused": true}').is_done
        assert request(node, "activate")
        assert controls.answer('{"request": "pause", "is_paused": true}').is_paused
        before_s = node.mj_data.time
        assert controls.answer('{"request": "step"}').is_done
        assert node.mj_data.time == pytest.approx(before_s + node.mj_model.opt.timestep)
        assert controls.answer('{"request": "reset", "keyframe": null}').is_done
        assert node.mj_data.time == 0.0
        report = controls.answer('{"request": "speed", "realtime_factor": 0.5}')
        assert (report.is_done, report.realtime_factor) == (True, 0.5)
        assert controls.answer('{"request": "pause", "is_paused": false}').is_done
        eventually(lambda: node.mj_data.time > 0.0, "that it continues")


@pytest.mark.parametrize("report_rates", [True, False])
def test_a_simulation_that_cannot_keep_up_is_logged_only_if_no_rate_shows_it(
    report_rates: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    with simulator(realtime_factor=1e5, report_rates=report_rates) as (node, collect):
        rtf = collect(Float64, "/sim/rtf")
        assert request(node, "configure")
        assert request(node, "activate")
        eventually(lambda: len(rtf) > 1, "seconds that were reported")
    assert ("simulation could not keep up" in capfd.readouterr().err) != report_rates


def realtime_factors(reported: Iterable[DiagnosticArray]) -> list[float]:
    return [
        float(status.values[0].value)
        for array in reported
        for status in array.status
        if status.name == "sim: realtime_factor"
    ]


def test_a_control_message_without_a_control_is_rejected() -> None:
    setting = "{topic: /ctrl, msg_type: VelocityCommand}"
    with simulator(sub_ctrl_setting=setting) as (node, _):
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert "VelocityCommand " in node.last_fault.text


def test_shutting_down_while_it_steps_ends_it() -> None:
    with simulator() as (node, _):
        assert request(node, "configure")
        assert request(node, "activate")
        assert request(node, "shutdown")
        assert node.state_label == "finalized"


def test_the_module_runs_as_a_process() -> None:
    command = [sys.executable, "-m", "obelisk_py.core.sim.mujoco", "--ros-args", "-r", "__node:=a"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    rclpy.init()
    try:
        looking = rclpy.create_node("looking")
        assert looking.create_client(GetState, "/a/get_state").wait_for_service(DEADLINE_S)
        process.terminate()
        assert process.wait(DEADLINE_S) == 0
    finally:
        rclpy.shutdown()
        process.kill()
        process.communicate()


def test_a_simulator_with_a_message_type_requires_its_control_subscription() -> None:
    with spinning(lambda: ObeliskMujocoRobot("robot", PositionSetpoint)) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert "set the parameter `sub_ctrl_setting`" in node.last_fault.text
