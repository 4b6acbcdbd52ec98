"""`ObeliskMujocoRobot`: a lifecycle node that simulates the robot in MuJoCo, for any model.

Inputs: the `sim` block as a string in the ROS parameter `mujoco_setting`, and control messages.
Outputs: the block's sensor groups, `TrueSimState`, markers of geoms, `~/rtf`, and `/clock` with
`use_sim_time`. Services: `~/reset`, `~/pause`, `~/step`. The stepping thread publishes everything
that is sampled in simulated time.
"""

import threading
import time
from array import array
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from ament_index_python.packages import PackageNotFoundError, get_package_share_path
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.parameter import Parameter
from std_msgs.msg import Float64

from obelisk_py.core.clock_page import open_clock_writer
from obelisk_py.core.command_watchdog import LastingRejection, RejectionReport
from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError
from obelisk_py.core.intra_process import disconnect_all
from obelisk_py.core.obelisk_typing import ObeliskControlMsg
from obelisk_py.core.parameter_rules import Getter
from obelisk_py.core.rate_monitor import REPORT_RATES, TickCounter
from obelisk_py.core.robot import ObeliskSimRobot, TrueSimState
from obelisk_py.core.sim.mujoco.control import ControlInbox, WhenStale, make_inbox
from obelisk_py.core.sim.mujoco.loading import check_keyframe, load_model
from obelisk_py.core.sim.mujoco.outputs import (
    OutputContext,
    SimulationClock,
    no_rate_monitor,
    outputs_of,
)
from obelisk_py.core.sim.mujoco.sensors.kind import WORLD
from obelisk_py.core.sim.mujoco.sim_config import (
    DEFAULT_CLOCK_RATE_HZ,
    PARAMETER,
    clock_rate_hz_of,
    read_block,
    realtime_factor_of,
)
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.step_queue import StepQueue, StepResult, make_step_services
from obelisk_py.core.sim.mujoco.step_times import NS_PER_S, MonotonicClock, Pace, SampleTimes
from obelisk_py.core.sim.mujoco.stepper import SkippedTime, Stepper, StepReport, TimedOutput
from obelisk_py.core.sim.mujoco.viewers.processes import (
    PARAMETERS,
    ViewerHost,
    requested_viewers,
    viewer_outputs,
)
from obelisk_py.core.sim.mujoco.viewers.video import (
    VIDEO_PARAMETERS,
    VideoDiagnostics,
    requested_video,
    video_outputs,
)
from obelisk_py.core.sim.mujoco.viewers.viewer_controls import ViewerControls
from obelisk_py.core.sim.mujoco.viewers.viewer_messages import Severity
from obelisk_py.core.sim.mujoco.viewers.viewer_requests import Report
from obelisk_spec.control_socket import report_page
from obelisk_spec.page_access import new_token
from obelisk_spec.runtime_protocol import STEPS, USE_SIM_TIME
from obelisk_spec.sim_block import CLOCK_RATE, REALTIME_FACTOR
from obelisk_spec.video import VideoStatus

__all__ = ["ObeliskMujocoRobot", "StateCopy", "TrueStateReader"]

Array = NDArray[np.float64]

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True, slots=True, kw_only=True)
class StateCopy:
    """The state at one time, safe to read while the simulation continues."""

    stamp_ns: int
    qpos: Array
    """Shape `(nq,)`."""
    qvel: Array
    """Shape `(nv,)`."""


class TrueStateReader:
    """Converts copies of a model's state to messages."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Find the base and the joints of a model."""
        joints = range(model.njnt)
        base = next((j for j in joints if model.jnt_type[j] == _FREE), None)
        scalar = [j for j in joints if model.jnt_type[j] in _SCALAR]
        self._has_y = hasattr(TrueSimState, "y")  # in the original message, not in every layout
        self._base_name = "" if base is None else model.body(int(model.jnt_bodyid[base])).name
        self._base_qpos = None if base is None else int(model.jnt_qposadr[base])
        self._base_qvel = None if base is None else int(model.jnt_dofadr[base])
        self._joint_names = [model.joint(j).name for j in scalar]
        self._joint_qpos = model.jnt_qposadr[scalar].astype(np.intp)
        self._joint_qvel = model.jnt_dofadr[scalar].astype(np.intp)

    def message(self, state: StateCopy) -> TrueSimState:
        """Convert a state to a message."""
        message = TrueSimState()
        seconds, nanoseconds = divmod(state.stamp_ns, NS_PER_S)
        message.header.stamp = Time(sec=seconds, nanosec=nanoseconds)
        message.header.frame_id = WORLD
        if self._has_y:
            message.y = _doubles(np.concatenate((state.qpos, state.qvel)))
        message.base_link_name = self._base_name
        if self._base_qpos is not None and self._base_qvel is not None:
            pose = state.qpos[self._base_qpos : self._base_qpos + 7]
            message.q_base = _doubles(pose[[0, 1, 2, 4, 5, 6, 3]])
            message.v_base = _doubles(state.qvel[self._base_qvel : self._base_qvel + 6])
        message.q_joints = _doubles(state.qpos[self._joint_qpos])
        message.v_joints = _doubles(state.qvel[self._joint_qvel])
        message.joint_names = self._joint_names
        return message


def _doubles(values: Array) -> "array[float]":
    # rclpy assigns this type as is; it converts anything else element by element.
    return array("d", values.tobytes())


KEYFRAME: Final = "ic_keyframe"
_DEPTH: Final = 10
_PAUSE_S: Final = 0.05
"""Maximum time until a paused simulation reacts to a stop request [s]."""


class ObeliskMujocoRobot(ObeliskSimRobot):
    """A simulated robot and its viewers.

    A subclass may override `apply_control` to read its own control messages. It then passes numbers
    to `_set_shared_ctrl(ctrl)`, or another message to `super().apply_control(message)`.

    ROS parameters: `mujoco_setting` (the sim block), `ic_keyframe` (default: `ic` if the model has
    it), `realtime_factor` (simulated time per wall time; 0 for as fast as possible; a configured
    node accepts other values above 0), `clock_rate` (maximum rate of `/clock` [Hz of simulated
    time]), `viewer` (`none`, `native`, `web`), `viewer_port` (port of the web viewer; 0 for any
    free port), `render` (video file), `render_camera`, `render_size`, `render_fps` (empty or 0 for
    the defaults of camera and file type).
    """

    def __init__(
        self,
        node_name: str = "obelisk_mujoco_robot",
        ctrl_msg_type: type[Any] | None = None,
        **kwargs: Any,
    ) -> None:
        """Create the node.

        Args:
            node_name: name in the ROS graph, unless it is remapped.
            ctrl_msg_type: class of the control message; None uses the type from the config.
            kwargs: passed to `rclpy.node.Node`.
        """
        super().__init__(node_name, ctrl_msg_type, **kwargs)
        # The control subscription is required, with or without a message type.
        self._has_message_types = False
        self.declare_parameter(PARAMETER, "")
        self.declare_parameter(KEYFRAME, "")
        # A config may set 0 or 1 as well as 0.5.
        self.declare_parameter(REALTIME_FACTOR, 1.0, ParameterDescriptor(dynamic_typing=True))
        self.declare_parameter(
            CLOCK_RATE, DEFAULT_CLOCK_RATE_HZ, ParameterDescriptor(dynamic_typing=True)
        )
        for name, default in {**PARAMETERS, **VIDEO_PARAMETERS}.items():
            self.declare_parameter(name, default)
        self._simulation: Simulation | None = None
        self._inbox: ControlInbox | None = None
        self._stepper: Stepper | None = None
        self._skipped_time = SkippedTime()
        self._true_state: TrueStateReader | None = None
        self._state_copy: StateCopy | None = None
        self._stamp_ns: Callable[[], int] = self._ros_time_ns
        self._keyframe: str | None = None
        self._own_publishers: list[LifecyclePublisher] = []
        self._closing = ExitStack()
        self._video_diagnostics: VideoDiagnostics | None = None
        self._viewers: tuple[TimedOutput, ...] = ()
        self._page_token = ""
        """The token of all pages of this process, so that an open page can connect to the next."""
        self._requests = StepQueue(
            is_stepping=lambda: self.state_label == "active",
            is_immediate=self.surroundings.is_lockstep,
        )
        self._request_services: list[Any] = []
        rules = self._parameter_rules
        rules.add((REALTIME_FACTOR,), self._check_factor, is_read_at_configure=False)
        rules.add((CLOCK_RATE,), lambda value: clock_rate_hz_of(value(CLOCK_RATE)))
        rules.add((PARAMETER,), lambda value: read_block(value(PARAMETER)))
        rules.add(tuple(PARAMETERS), requested_viewers)
        rules.add(tuple(VIDEO_PARAMETERS), requested_video)
        rules.add((KEYFRAME,), self._check_keyframe, is_read_at_configure=False)
        self.add_post_set_parameters_callback(self._change_speed)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read and check the sim block, load the model, and create the publishers.

        Raises:
            ObeliskConfigError: the message contains every finding about the block.
        """
        result = super().on_configure(state)
        factor = realtime_factor_of(self.get_parameter(REALTIME_FACTOR).value)
        viewers = requested_viewers(lambda name: self.get_parameter(name).value)
        video = requested_video(lambda name: self.get_parameter(name).value)
        self._page_token = self._page_token or (new_token() if viewers else "")
        loaded = load_model(
            str(self.get_parameter(PARAMETER).value),
            keyframe=str(self.get_parameter(KEYFRAME).value),
            folder=Path.cwd(),
            share_of=_share_of,
            warn=self._warn,
        )
        self._keyframe = loaded.keyframe
        self._inbox = make_inbox(
            self._read_msg_type(),
            loaded.model,
            now_ns=lambda: self._stamp_ns(),
            lateness_s=self._command_age.policy.max_age_s
            if self._command_age is not None
            else None,
        )
        # By default, MuJoCo writes its warnings to a file in the working directory. Here they are
        # read from the state after each step.
        mujoco.set_mju_user_warning(_drop)
        self._simulation = Simulation(loaded.model, self._inbox, self._when_stale())
        # Viewers show the initial state before the first step.
        self._simulation.reset(self._keyframe)
        self._stamp_ns = self._choose_stamp()
        context = OutputContext(
            make_publisher=self._own_publisher,
            warn=self._warn,
            on_close=self._closing.callback,
            is_paced=factor > 0,
            is_lockstep=self.surroundings.is_lockstep,
            noise_seed=self.surroundings.noise_seed,
            # In lockstep, samples are on time by definition, and no rate is published.
            monitor_rate=self._monitor_samples
            if factor and not self.surroundings.is_lockstep
            else no_rate_monitor,
        )
        if video is not None:
            self._video_diagnostics = VideoDiagnostics(self)
            self._closing.callback(self._video_diagnostics.close)
        sensors = outputs_of(self._simulation, loaded.config, context)
        self._viewers = viewer_outputs(
            self._simulation,
            viewers,
            loaded.config.steps_per_view,
            host=self._viewer_host(self._simulation),
            on_close=self._closing.callback,
        )
        outputs = (
            *sensors,
            *self._viewers,
            *video_outputs(
                self._simulation,
                video,
                report=self._report_video,
                on_close=self._closing.callback,
            ),
        )
        self._stepper = self._make_stepper(self._simulation, factor, outputs)
        self._request_services = make_step_services(
            self.create_service,
            self._requests,
            reset=self._reset_to_parameter,
            step=self._step,
        )
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Reset to the keyframe and start stepping."""
        self._reset(self._read_keyframe())
        self._requests.is_paused = False
        return super().on_activate(state)

    def run_simulator(self) -> None:
        """Step until the node is deactivated."""
        assert self._stepper is not None
        stop, requests = self.simulator_stop, self._requests
        is_set, is_waiting = stop.is_set, requests.is_waiting

        def interrupted() -> bool:
            return is_set() or is_waiting()

        while not stop.is_set():
            if requests.is_paused:
                requests.wait(_PAUSE_S)
                if self._command_age is not None:
                    # Commands do not age while the simulation is paused.
                    self._command_age.postpone(time.monotonic())
            else:
                self._stepper.run(interrupted)
                self._show_now()
            requests.run_pending()

    def step_once(self) -> None:
        """Take the next step and publish what is due, unless the robot is paused."""
        assert self._stepper is not None
        if not self._requests.is_paused:
            self._stepper.advance()
        elif self._command_age is not None:
            self._command_age.postpone(time.monotonic())

    def next_step_ns(self) -> int:
        """Simulated time from the current step to the next one [ns]."""
        return self._configured().next_step_ns

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Free the model."""
        result = super().on_cleanup(state)
        self._free()
        return result

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop stepping and free the model, in any state."""
        result = super().on_shutdown(state)
        self._free()
        return result

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop stepping and free the model."""
        result = super().on_error(state)
        self._free()
        return result

    def apply_control(self, control_msg: ObeliskControlMsg) -> bool:
        """Apply a control at the next step, or reject it.

        Args:
            control_msg: the latest control.

        Returns:
            Whether it will be applied.
        """
        inbox = self._inbox
        if inbox is None:
            return False
        is_taken = inbox.offer(control_msg)
        self.report_rejections(is_last=False)
        return is_taken

    @property
    def mj_model(self) -> mujoco.MjModel:
        """The model; available while the node is configured.

        Raises:
            ObeliskError: the node is not configured.
        """
        return self._configured().model

    @property
    def mj_data(self) -> mujoco.MjData:
        """The state of the simulation; the stepping thread changes it.

        Raises:
            ObeliskError: the node is not configured.
        """
        return self._configured().data

    @property
    def shared_ctrl(self) -> Array:
        """A copy of the actuators' controls, shape `(nu,)`.

        Raises:
            ObeliskError: the node is not configured.
        """
        self._end_existing_simulator()
        data, inbox = self.mj_data, self._inbox
        newest = inbox.newest if inbox is not None else None
        return newest.copy() if isinstance(newest, np.ndarray) else data.ctrl.copy()

    @shared_ctrl.setter
    def shared_ctrl(self, shared_ctrl: Any) -> None:
        self._set_shared_ctrl(shared_ctrl)

    def _set_shared_ctrl(self, ctrl: Iterable[float]) -> None:
        """Apply controls at the next step, or reject and log them.

        For subclasses whose `apply_control` computes them from a message of any type. A message
        whose controls are rejected does not count as a command.

        Args:
            ctrl: one number per actuator of the model.
        """
        if self._inbox is not None:
            self._inbox.put(ctrl)
            self.report_rejections(is_last=False)

    def push_body(
        self, body: int, force: Sequence[float], duration_s: float, torque: Sequence[float]
    ) -> None:
        """Push a body during the next steps, as `Simulation.push` does.

        Raises:
            ObeliskError: the node is not configured.
        """
        self._configured().push(body, force, duration_s, torque)

    def _configured(self) -> Simulation:
        if self._simulation is None:
            raise ObeliskError("the simulator has a model only while it is configured")
        return self._simulation

    def _read_msg_type(self) -> Any | None:
        """Return the message type that the inbox reads; None if a subclass reads the messages."""
        if type(self).apply_control is not ObeliskMujocoRobot.apply_control:
            return None
        msg_type: Any = self.obk_subscriptions["sub_ctrl"].msg_type
        return msg_type

    def publish_true_sim_state(self) -> TrueSimState:
        """Publish the latest state on `pub_true_sim_state`, and return it."""
        assert self._true_state is not None
        assert self._state_copy is not None
        message = self._true_state.message(self._state_copy)
        self.obk_publishers["pub_true_sim_state"].publish(message)
        return message

    def _reset(self, keyframe: str | None) -> StepResult:
        assert self._simulation is not None
        self._simulation.reset(keyframe)
        self._forget_commands()
        self._copy_state(self._stamp_ns())
        return StepResult(is_done=True, text=f"at {keyframe or 'the initial state'}")

    def _reset_to_parameter(self) -> StepResult:
        """Reset to the keyframe in the current value of `ic_keyframe`."""
        return self._reset_and_show(self._read_keyframe())

    def _read_keyframe(self) -> str | None:
        """The keyframe in the current value of `ic_keyframe`, otherwise the one in use."""
        self._keyframe = str(self.get_parameter(KEYFRAME).value) or self._keyframe
        return self._keyframe

    def _reset_and_show(self, keyframe: str | None) -> StepResult:
        assert self._stepper is not None
        answer = self._reset(keyframe)
        # Viewers of a paused simulation show the reset state.
        self._stepper.begin()
        return answer

    def _step(self) -> StepResult:
        assert self._stepper is not None
        assert self._simulation is not None
        self._stepper.step()
        self._show_now()
        return StepResult(is_done=True, text=f"at {self._simulation.time_ns / NS_PER_S:.12g} s")

    def _show_now(self) -> None:
        """Send viewers the current state, because it may be that of a paused simulation."""
        for viewer in self._viewers:
            viewer.publish(0)

    def _viewer_host(self, simulation: Simulation) -> ViewerHost:
        controls = ViewerControls(
            simulation=simulation,
            queue=self._requests,
            step=self._step,
            reset=self._reset_and_show,
            set_speed=self._set_speed,
            report=self._viewer_report,
            log=self._info,
        )
        return ViewerHost(
            controls=controls,
            name=self.get_name(),
            token=self._page_token,
            notify=self._log,
            show_page=lambda url: report_page(self.get_fully_qualified_name(), url),
        )

    def _viewer_report(self) -> Report:
        return Report(
            state=self.state_label,
            is_paused=self._requests.is_paused,
            realtime_factor=float(self.get_parameter(REALTIME_FACTOR).value),
        )

    def _set_speed(self, factor: float) -> StepResult:
        (result,) = self.set_parameters([Parameter(REALTIME_FACTOR, value=factor)])
        return StepResult(is_done=result.successful, text=result.reason)

    def _check_factor(self, value: Getter) -> None:
        """Check the real-time factor; a configured node cannot switch between paced and unpaced."""
        factor = realtime_factor_of(value(REALTIME_FACTOR))
        if self._stepper is not None and self._stepper.is_paced != (factor > 0):
            raise ObeliskConfigError(
                f"`{REALTIME_FACTOR}` changes from or to 0 (as fast as possible) only in the "
                "`configure` transition: clean up, set it, configure again"
            )

    def _change_speed(self, parameters: list[Parameter]) -> None:
        """Apply a new real-time factor; called after parameters were set, on any thread."""
        factors = [one.value for one in parameters if one.name == REALTIME_FACTOR]
        if self._stepper is None or self._simulation is None or not any(factors):
            return
        factor = realtime_factor_of(factors[-1])
        self._stepper.set_speed(factor)
        self.rates.expect_anew(STEPS, factor / self._simulation.step_s)
        # Interrupts the steps at the old speed.
        self._requests.submit(lambda: StepResult(is_done=True, text=""))

    def _check_keyframe(self, value: Getter) -> None:
        """Check that the model has the keyframe for the next reset."""
        if self._simulation is not None:
            check_keyframe(self._simulation.model, value(KEYFRAME))

    def _when_stale(self) -> WhenStale | None:
        if self._command_age is None:
            return None
        return WhenStale(action=self._command_age.policy.action, is_stale=self._is_stale)

    def _make_simulator(self, stop: threading.Event) -> threading.Thread:
        assert self._stepper is not None
        steps = self.surroundings.drive(self, self)
        if steps is None:
            return super()._make_simulator(stop)
        self._stepper.begin()  # in a normal run, the thread does this itself
        return steps

    def _start_watchdog(self) -> None:
        """Start no thread, because the stepping thread checks the age before each step."""

    def _can_damp(self) -> bool:
        return True  # with the actuators

    def _rejection_of(self, _control_msg: ObeliskControlMsg) -> None:
        """Accept everything here, because the inbox checks the fields that the simulation reads."""

    def _reject_by_answer(self) -> None:
        if self._inbox is None or not self._inbox.has_rejected:
            super()._reject_by_answer()  # otherwise the inbox has counted it, with its reason

    def _applies(self, control_msg: ObeliskControlMsg) -> bool:
        """Apply a command; false if `apply_control` or the inbox rejects it.

        A subclass's `apply_control` may ignore that the inbox has rejected what it passed on.
        """
        inbox = self._inbox
        assert inbox is not None
        inbox.has_rejected = False
        return super()._applies(control_msg) and not inbox.has_rejected

    def lasting_rejection(self) -> LastingRejection | None:
        """The rejections since the last accepted command; None if they span less than 1 s."""
        return None if self._inbox is None else self._inbox.lasting_rejection()

    def _make_stepper(
        self, simulation: Simulation, factor: float, outputs: tuple[TimedOutput, ...]
    ) -> Stepper:
        rtf = self._own_publisher(Float64, "~/rtf", _DEPTH)
        ticks = TickCounter()
        if factor:
            self.rates.expect(STEPS, factor / simulation.step_s, ticks, self._time_of_steps_ns)

        def report(measured: StepReport) -> None:
            ticks.overruns += measured.overruns
            rtf.publish(Float64(data=measured.realtime_factor))
            self.rates.add_value(REALTIME_FACTOR, measured.realtime_factor)
            self._report(measured)

        return Stepper(
            simulation,
            pace=Pace(simulation.step_s / factor) if factor else None,
            clock=MonotonicClock(),
            outputs=(*self._every_step(simulation), *outputs),
            stamp=self._stamp_ns,
            warn=self._warn,
            report=report,
            ticks=ticks,
            time_output=self._make_clock(simulation),
        )

    def _make_clock(self, simulation: Simulation) -> SimulationClock | None:
        if not self._uses_simulation_time() or self.surroundings.is_lockstep:
            return None
        return SimulationClock(
            self._own_publisher,
            page=open_clock_writer(),
            rate_hz=clock_rate_hz_of(self.get_parameter(CLOCK_RATE).value),
            time_ns=lambda: simulation.time_ns,
        )

    def _time_of_steps_ns(self) -> int | None:
        """The clock for the expected step rate; None while the simulation is paused."""
        return None if self._requests.is_paused else time.monotonic_ns()

    def _monitor_samples(self, topic: str, period_s: float) -> Callable[[], None]:
        simulation = self._simulation
        assert simulation is not None
        name = self.resolve_topic_name(topic)
        return self.rates.expect_samples(name, period_s, lambda: simulation.time_ns)

    def _every_step(self, simulation: Simulation) -> list[TimedOutput]:
        """Return the outputs after each step, before the sensors: the copy for `TrueSimState`."""
        step_s = simulation.step_s
        outputs: list[TimedOutput] = []
        if "pub_true_sim_state" in self.obk_publishers:
            self._true_state = TrueStateReader(simulation.model)
            times = SampleTimes(period_s=step_s, step_s=step_s)
            outputs.append(TimedOutput(times=times, publish=self._copy_state))
            if "timer_true_sim_state" not in self.obk_timers:
                self._warn("`pub_true_sim_state` publishes nothing without `timer_true_sim_state`")
        elif "timer_true_sim_state" in self.obk_timers:
            raise ObeliskConfigError(
                "the config sets `timer_true_sim_state`, but not its publisher `pub_true_sim_state`"
            )
        return outputs

    def _uses_simulation_time(self) -> bool:
        return bool(self.get_parameter(USE_SIM_TIME).value)

    def _choose_stamp(self) -> Callable[[], int]:
        """Choose the function that returns messages' stamps: the time of the node's clock [ns]."""
        if self.surroundings.is_lockstep:
            # All nodes' clocks have the time of the step, and never jump back.
            return self._ros_time_ns
        # rclpy's clock would return the same time, a hundred times more slowly.
        return self._simulation_time_ns if self._uses_simulation_time() else time.time_ns

    def _ros_time_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _simulation_time_ns(self) -> int:
        assert self._simulation is not None
        return self._simulation.time_ns

    def _copy_state(self, stamp_ns: int) -> None:
        assert self._simulation is not None
        data = self._simulation.data
        self._state_copy = StateCopy(
            stamp_ns=stamp_ns, qpos=data.qpos.copy(), qvel=data.qvel.copy()
        )

    def _report(self, report: StepReport) -> None:
        self.report_rejections(is_last=False)
        # A node that reports its rates reports this as the rate `steps`.
        if self.get_parameter(REPORT_RATES).value:
            return
        if warning := self._skipped_time.add(report):
            self._warn(warning)

    def _rejection_reports(self, *, is_last: bool) -> list[RejectionReport]:
        reports = super()._rejection_reports(is_last=is_last)
        return reports + (self._inbox.reports(is_last=is_last) if self._inbox is not None else [])

    def _own_publisher(self, message: type[Any], topic: str, depth: int) -> LifecyclePublisher:
        publisher: LifecyclePublisher = self.create_lifecycle_publisher(message, topic, depth)
        self._own_publishers.append(publisher)
        return publisher

    def _warn(self, text: str) -> None:
        self.get_logger().warning(text)

    def _info(self, text: str) -> None:
        self.get_logger().info(text)

    def _log(self, severity: Severity, text: str) -> None:
        if severity == "info":
            self._info(text)
        else:
            self._warn(text)

    def _report_video(self, video: VideoStatus) -> None:
        self._log("warning" if video.state == "failed" else "info", str(video))
        if self._video_diagnostics is not None:
            self._video_diagnostics.publish(video)

    def _free(self) -> None:
        self._closing.close()
        for service in self._request_services:
            self.destroy_service(service)
        self._request_services.clear()
        self._viewers = ()
        self._stepper = self._simulation = self._inbox = None
        self._true_state = self._state_copy = None
        disconnect_all(self._own_publishers)
        for publisher in self._own_publishers:
            self.destroy_lifecycle_publisher(publisher)
        self._own_publishers.clear()


def _share_of(package: str) -> Path | None:
    try:
        return Path(get_package_share_path(package))
    except (PackageNotFoundError, ValueError, OSError):  # ValueError: it cannot be a package's name
        return None


def _drop(_text: str) -> None:
    """Ignore a MuJoCo warning."""
