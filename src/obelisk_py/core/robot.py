"""`ObeliskRobot` and `ObeliskSimRobot`: base classes of real and simulated robots.

`non_finite_number` checks the numbers in a message of any type, and `zeroed` replaces them with 0.
`zeroed` keeps headers unchanged, because a header describes the message.
"""

import copy
import ctypes
import functools
import math
import threading
import time
from abc import ABC, abstractmethod
from array import array
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any, Final

import numpy as np
from rclpy.lifecycle import LifecycleState
from rclpy.subscription import Subscription
from std_msgs.msg import Header

from obelisk_py.core.command_watchdog import (
    ONLY_REJECTIONS,
    SILENCE_GRACE_S,
    CommandAge,
    LastingRejection,
    RejectionLog,
    RejectionReport,
    SilenceLog,
    StalePolicy,
)
from obelisk_py.core.components import RegisteredComponent
from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError
from obelisk_py.core.messages import optional_message
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.obelisk_typing import ObeliskControlMsg
from obelisk_py.core.settings import stale_policy
from obelisk_py.core.surroundings import Watchdog
from obelisk_spec.components import CONTROL_SUBSCRIPTION
from obelisk_spec.runtime_protocol import REJECTION, rejection_values

__all__ = ["ObeliskRobot", "ObeliskSimRobot", "TrueSimState", "non_finite_number"]

TrueSimState: Any = optional_message("TrueSimState")
LONGEST_STOP_S = 5.0
"""Maximum time for `run_simulator`, or the action on stale commands, to return [s]."""
LONGEST_IDLE_S = 5.0
"""Time after activation by which a robot usually has its first command [s]."""
LOOP_GRACE_S = 0.5
"""Time for a loop that does not read `simulator_stop` to end by itself [s]."""

_ACTIONS: Final = {
    "zero": "every control value is set to zero",
    "hold": "the last command is kept",
    "damp": "the robot brakes",
}


class ObeliskRobot(ABC, ObeliskNode):
    """Base class of robots.

    Registers the subscription `sub_ctrl` -> `apply_control` with the ROS parameter
    `sub_ctrl_setting`. Subclasses register the publishers of their sensors.

    With `max_age_sec` in the settings of that subscription, the robot executes `stale_action` if it
    accepts no command for this long on the steady clock, even if the executor is busy.
    """

    def __init__(
        self, node_name: str, ctrl_msg_type: type[Any] | None = None, **kwargs: Any
    ) -> None:
        """Create the node and register the control subscription.

        Args:
            node_name: name in the ROS graph, unless it is remapped.
            ctrl_msg_type: class of the control message; None uses the type from the config.
            kwargs: passed to `rclpy.node.Node`.
        """
        super().__init__(node_name, **kwargs)
        self._command_age: CommandAge | None = None
        self._silence_log = SilenceLog()
        self._watchdog: Watchdog | None = None
        self._newest_control: Any = None
        self._rejections = RejectionLog("control rejected", time.monotonic, ONLY_REJECTIONS)
        self._has_reported_rejection = False
        self.rates.watch_fault(REJECTION, self._rejection_values)
        self._idle_since_s: float | None = None
        """Since when the active robot waits for its first command [s]; None if it does not."""
        self.rates.at_each_report(self._warn_if_idle)
        # apply_control has one caller at a time: the executor's thread or the watchdog.
        self._applying = threading.Lock()
        self._is_acting = False
        """Whether the action on stale commands is running."""
        self.rates.at_each_report(self._report_hanging_action)
        # A literal key, because `obk validate` reads constructors without running them.
        self.register_obk_subscription(
            "sub_ctrl_setting", self._take_control, key="sub_ctrl", msg_type=ctrl_msg_type
        )
        self._has_message_types = ctrl_msg_type is not None

    @abstractmethod
    def apply_control(self, control_msg: ObeliskControlMsg) -> bool | None:
        """Apply a control message to the system; called only while the node is active.

        It is called on the executor's thread, or with `max_age_sec` also on another thread, but
        never on both at the same time.

        Args:
            control_msg: the latest control.

        Returns:
            False if the robot rejects it, so that it does not count as a command; the node logs the
            number of rejected commands. Otherwise None.
        """

    def apply_damping(self) -> None:
        """Brake because the latest command is stale; called once until the next command.

        With `stale_action: damp`, called instead of `apply_control` and under the same lock.

        Raises:
            ObeliskConfigError: the subclass does not implement it.
        """
        raise ObeliskConfigError(
            f"{type(self).__name__} does not implement apply_damping, "
            "but the config sets `stale_action: damp`"
        )

    def _take_control(self, control_msg: ObeliskControlMsg) -> None:
        # An inactive robot must not move, even if a node still publishes commands.
        if self.state_label != "active":
            return
        self._idle_since_s = None
        if self._command_age is None:
            if self._applies(control_msg):
                self._rejections.accept()
            else:
                self._reject_by_answer()
            return
        rejection = self._rejection_of(control_msg)
        if rejection is not None:
            self._rejections.add(rejection)
            self.report_rejections(is_last=False)
            return
        with self._applying:
            is_applied = self._applies(control_msg)
            if is_applied:
                self._newest_control = control_msg
                was_idle = self._command_age.deadline_s is None
                silent_s = self._command_age.accept(time.monotonic())
        if not is_applied:
            self._reject_by_answer()
            return
        self._rejections.accept()
        if was_idle and self._watchdog is not None:
            self._watchdog.wake()
        if silent_s is not None and self._silence_log.end(silent_s):
            self.get_logger().warning(f"commands resumed after {silent_s:.3f} s")

    def _reject_by_answer(self) -> None:
        """Count a command for which `apply_control` returned False."""
        self._rejections.add("apply_control returned False")
        self.report_rejections(is_last=False)

    def _applies(self, control_msg: ObeliskControlMsg) -> bool:
        """Apply a command; returns whether it counts as one."""
        return self.apply_control(control_msg) is not False

    def _rejection_of(self, control_msg: ObeliskControlMsg) -> str | None:
        """Return the reason to reject a command before `apply_control`; None to accept it."""
        return non_finite_number(control_msg)

    def lasting_rejection(self) -> LastingRejection | None:
        """The rejections since the last accepted command; None if they span less than 1 s."""
        return self._rejections.lasting()

    def _rejection_values(self) -> tuple[tuple[str, str], ...] | None:
        """The status for `/diagnostics` while all commands are rejected, and once after that."""
        lasting, was_reported = self.lasting_rejection(), self._has_reported_rejection
        self._has_reported_rejection = lasting is not None
        if lasting is not None:
            return rejection_values(lasting.seconds, lasting.reason)
        return rejection_values(0.0, "") if was_reported else None

    def _warn_if_idle(self) -> None:
        """Warn once if no command arrives after activation."""
        since_s = self._idle_since_s
        if since_s is None or time.monotonic() - since_s < LONGEST_IDLE_S:
            return
        self._idle_since_s = None
        topic = self.obk_subscriptions[CONTROL_SUBSCRIPTION].topic_name
        ends = self.get_publishers_info_by_topic(topic)
        names = {f"{end.node_namespace.rstrip('/')}/{end.node_name}" for end in ends}
        who = f"its publishers: {', '.join(sorted(names))}" if names else "it has no publishers"
        self.get_logger().warning(
            f"no command has arrived on {topic} in the {LONGEST_IDLE_S:g} s since activation; {who}"
        )

    def _can_damp(self) -> bool:
        return type(self).apply_damping is not ObeliskRobot.apply_damping

    def report_rejections(self, *, is_last: bool = True) -> None:
        """Log the number of commands rejected since the last report.

        Args:
            is_last: log even if the last report was less than a second ago.
        """
        for report in self._rejection_reports(is_last=is_last):
            self._log_rejection(report)

    def _rejection_reports(self, *, is_last: bool) -> list[RejectionReport]:
        report = self._rejections.report(is_last=is_last)
        return [] if report is None else [report]

    def _log_rejection(self, report: RejectionReport) -> None:
        # Two calls, because rclpy does not allow a call site to change its severity.
        if report.is_lasting:
            self.get_logger().error(report.text)
        else:
            self.get_logger().warning(report.text)

    def _is_stale(self) -> bool:
        """Whether the latest command is stale; also logs stopped commands when due."""
        assert self._command_age is not None
        self._becomes_stale()
        return self._command_age.is_stale

    def _becomes_stale(self) -> bool:
        """Whether the latest command has just become stale; logs stopped commands when due."""
        assert self._command_age is not None
        now_s = time.monotonic()
        is_new = self._command_age.look(now_s) is not None
        if is_new:
            self._silence_log.begin(now_s)
        due_s = self._silence_log.due_s
        if due_s is not None and now_s >= due_s:
            self._log_silence(now_s)
        return is_new

    def _log_silence(self, now_s: float) -> None:
        assert self._command_age is not None
        silent_s, policy = self._command_age.silence_s(now_s), self._command_age.policy
        text = (
            f"{self._silence_log.report(now_s, silent_s)}, more than `max_age_sec` of "
            f"{policy.max_age_s:g} s: {_ACTIONS[policy.action]} (`stale_action: {policy.action}`)"
        )
        if self._is_acting:
            text += "; the action has not returned"
        elif self._watchdog is not None and self._applying.locked():
            text += "; the action is delayed because apply_control has not returned"
        topic = self.obk_subscriptions[CONTROL_SUBSCRIPTION].topic_name
        if silent_s is not None and self.count_publishers(topic) == 0:
            # The controller may have been stopped on purpose; the launcher reports a crash.
            self.get_logger().warning(f"{text}; no node publishes {topic} any more")
        else:
            self.get_logger().error(text)

    def _act_if_stale(self) -> None:
        if self.state_label != "active":
            # `on_deactivate` brings the robot to rest; an action in the middle of it may do harm.
            self._forget_commands()
            return
        if self._becomes_stale():
            try:
                self.guarded(self._act_on_old_commands)()
            except SystemExit as error:  # it would end only this thread
                self.fail(error, "the action on stale commands")

    def _report_hanging_action(self) -> None:
        """Log missing commands if the thread that should do so is busy with the action."""
        due_s = self._silence_log.due_s
        if self._is_acting and due_s is not None and time.monotonic() >= due_s:
            self._log_silence(time.monotonic())

    def _act_on_old_commands(self) -> None:
        # While this waits for a hanging apply_control, the hang is logged.
        while not self._applying.acquire(timeout=SILENCE_GRACE_S):
            if not self._has_to_act():
                return
            self._becomes_stale()
        try:
            if self._has_to_act():
                self._is_acting = True
                self._make_safe()
        finally:
            self._is_acting = False
            self._applying.release()

    def _has_to_act(self) -> bool:
        """Whether the latest command is still stale and the node is still active."""
        assert self._command_age is not None
        return self._command_age.is_stale and self.state_label == "active"

    def _make_safe(self) -> None:
        assert self._command_age is not None
        if self._command_age.policy.action == "zero":
            control = zeroed(self._newest_control)
            if hasattr(control, "header"):
                control.header.stamp = self.get_clock().now().to_msg()
            if self.apply_control(control) is False:
                self.get_logger().error("the robot rejected the command of zeros")
        elif self._command_age.policy.action == "damp":
            self.apply_damping()

    def _make_subscription(
        self, component: RegisteredComponent, raw: Mapping[str, Any]
    ) -> Subscription:
        if component.key == CONTROL_SUBSCRIPTION:
            self._command_age = self._age_of(stale_policy(component, raw))
        return super()._make_subscription(component, raw)

    def _age_of(self, policy: StalePolicy | None) -> CommandAge | None:
        if policy is None:
            return None
        if policy.action == "damp" and not self._can_damp():
            self.apply_damping()  # raises an error that names the missing method
        return CommandAge(policy)

    def _start_components(self) -> None:
        super()._start_components()
        self._idle_since_s = time.monotonic()
        self._start_watchdog()

    def _stop_components(self, state: LifecycleState) -> None:
        self._stop_watchdog()
        self.report_rejections()
        super()._stop_components(state)

    def destroy_node(self) -> None:
        """Stop the watchdog and destroy the node; log an error if the watchdog does not stop."""
        try:
            self._stop_watchdog()
        except ObeliskError as error:
            self.get_logger().error(str(error))
        super().destroy_node()

    def _start_watchdog(self) -> None:
        if self._command_age is not None and self._watchdog is None:
            self._forget_commands()
            self._watchdog = self.surroundings.make_watchdog(
                self, self._next_deadline_s, self._act_if_stale
            )
            self._watchdog.start()

    def _next_deadline_s(self) -> float | None:
        assert self._command_age is not None
        times_s = (self._command_age.deadline_s, self._silence_log.due_s)
        return min((time_s for time_s in times_s if time_s is not None), default=None)

    def _forget_commands(self) -> None:
        """Return to the state before the first command."""
        self._rejections.accept()
        self._silence_log.forget()
        if self._command_age is not None:
            self._command_age.forget()

    def _stop_watchdog(self) -> None:
        if self._watchdog is None:
            return
        if not self._watchdog.stop(LONGEST_STOP_S):
            raise ObeliskError(
                f"the robot's action on stale commands was still running {LONGEST_STOP_S:g} s "
                "after the stop request"
            )
        self._watchdog = None


class ObeliskSimRobot(ObeliskRobot):
    """Base class of simulated robots.

    Registers two optional components: the timer `timer_true_sim_state` -> `publish_true_sim_state`
    and the publisher `pub_true_sim_state`. While the node is active, `run_simulator` runs in its
    own thread.

    Existing simulators pass commands with `_set_shared_ctrl(ctrl)` to `run_simulator`, which reads
    `shared_ctrl` under `lock` in an endless loop. If the class does not read `simulator_stop`, the
    next access to `lock` or `shared_ctrl` after a stop request ends that loop with `SystemExit`. A
    loop that accesses neither for 0.5 s is interrupted wherever it is.
    """

    def __init__(
        self, node_name: str, ctrl_msg_type: type[Any] | None = None, **kwargs: Any
    ) -> None:
        """Create the node and register its components.

        Args:
            node_name: name in the ROS graph, unless it is remapped.
            ctrl_msg_type: class of the control message; None uses the type from the config.
            kwargs: passed to `rclpy.node.Node`.
        """
        super().__init__(node_name, ctrl_msg_type, **kwargs)
        self._shared_ctrl_lock: Any = threading.RLock()
        self._shared_ctrl: Any = []
        self._simulator_stop = threading.Event()
        self._knows_stop = False
        """Whether the subclass has read `simulator_stop`."""
        self._simulator: threading.Thread | None = None
        self._is_stuck = False
        """Whether `run_simulator` ignored a stop request; then only the first stop waits."""
        self.register_obk_timer(
            "timer_true_sim_state_setting",
            self.publish_true_sim_state,
            key="timer_true_sim_state",
            required=False,
        )
        self.register_obk_publisher(
            "pub_true_sim_state_setting",
            key="pub_true_sim_state",
            msg_type=TrueSimState,
            required=False,
        )

    @property
    def simulator_stop(self) -> threading.Event:
        """Set when `run_simulator` must return."""
        self._knows_stop = True
        return self._simulator_stop

    @abstractmethod
    def run_simulator(self) -> None:
        """Step the simulation until `simulator_stop` is set; an exception fails the node.

        Each run has its own event, so read `self.simulator_stop` once, at the start.
        """

    @property
    def lock(self) -> Any:
        """Lock for access to `shared_ctrl`; kept for existing simulators."""
        self._end_existing_simulator()
        return self._shared_ctrl_lock

    @lock.setter
    def lock(self, lock: Any) -> None:
        self._shared_ctrl_lock = lock

    @property
    def shared_ctrl(self) -> Any:
        """The latest control, a list; kept for existing simulators.

        Before the first command it holds `n_u` zeros, if the node has an attribute `n_u`.
        """
        self._end_existing_simulator()
        return self._shared_ctrl

    @shared_ctrl.setter
    def shared_ctrl(self, shared_ctrl: Any) -> None:
        self._shared_ctrl = shared_ctrl

    def _set_shared_ctrl(self, ctrl: Iterable[float]) -> None:
        """Replace the contents of `shared_ctrl`; kept for existing simulators."""
        with self._shared_ctrl_lock:
            self._shared_ctrl[:] = [float(value) for value in ctrl]

    def _end_existing_simulator(self) -> None:
        # Existing simulators step forever, because they ran in a process that was terminated.
        if (
            self._simulator_stop.is_set()
            and not self._knows_stop
            and threading.current_thread() is self._simulator
        ):
            raise SystemExit

    def publish_true_sim_state(self) -> TrueSimState:
        """Publish the simulator's own state on `pub_true_sim_state`, and return it.

        Raises:
            ObeliskConfigError: the subclass does not implement it, but the config sets its timer.
        """
        raise ObeliskConfigError(
            f"{type(self).__name__} does not implement publish_true_sim_state, "
            "but the config sets timer_true_sim_state"
        )

    def destroy_node(self) -> None:
        """Stop the simulator's thread and destroy the node; if it does not stop, log an error."""
        try:
            self._stop_simulator()
        except ObeliskError as error:
            self.get_logger().error(str(error))
        super().destroy_node()

    def _start_components(self) -> None:
        super()._start_components()
        if self._simulator is None:
            if len(self._shared_ctrl) == 0:
                # Not with `_set_shared_ctrl`, which a subclass may treat as a command.
                self._shared_ctrl[:] = [0.0] * (getattr(self, "n_u", None) or 0)
            # A new event for each run, so that an old thread cannot resume.
            self._simulator_stop = threading.Event()
            self._simulator = self._make_simulator(self._simulator_stop)
            self._simulator.start()

    def _make_simulator(self, stop: threading.Event) -> threading.Thread:
        run = functools.partial(self._run_simulator_thread, stop)
        return self.surroundings.make_thread(self, run, "simulator")

    def _run_simulator_thread(self, stop: threading.Event) -> None:
        with suppress(SystemExit):
            self.guarded(self.run_simulator)()
        if not (stop.is_set() or self.is_failing()):
            self.get_logger().warning(
                "run_simulator returned before simulator_stop was set: the simulation has stopped"
            )

    def _stop_components(self, state: LifecycleState) -> None:
        self._stop_simulator()
        super()._stop_components(state)

    def _stop_simulator(self) -> None:
        self._simulator_stop.set()
        if self._simulator is None:
            return
        if self._simulator is threading.current_thread():
            # run_simulator failed in a node without an executor: this thread is about to end.
            self._simulator = None
            return
        # A loop that reads `lock` ends there; any other loop is interrupted wherever it is.
        interruption = threading.Timer(LOOP_GRACE_S, _end_loop, [self._simulator])
        may_need_interruption = self._simulator.is_alive() and not self._knows_stop
        if may_need_interruption:
            interruption.start()
        self._simulator.join(0 if self._is_stuck else LONGEST_STOP_S)
        interruption.cancel()
        if may_need_interruption:
            interruption.join()  # it holds references to the simulator and thus the node
        self._is_stuck = self._simulator.is_alive()
        if self._is_stuck:
            raise ObeliskError(
                f"run_simulator was still running {LONGEST_STOP_S:g} s after simulator_stop was set"
            )
        self._simulator = None


def _end_loop(thread: threading.Thread) -> None:
    """Raise SystemExit in a thread, at its next Python instruction."""
    if thread.ident is not None:
        set_exception = ctypes.pythonapi.PyThreadState_SetAsyncExc
        set_exception(ctypes.c_ulong(thread.ident), ctypes.py_object(SystemExit))


def non_finite_number(message: Any) -> str | None:
    """Describe the first NaN or infinity, as "`u_mujoco[0]` is nan"; None if all are finite."""
    return next(_non_finite(message, ""), None)


def zeroed(message: Any) -> Any:
    """Copy a message with every number set to 0; lengths, strings, booleans and headers stay."""
    zeros = type(message)()
    for field, value in _fields(message):
        setattr(zeros, field, _zeroed_value(value))
    return zeros


def _fields(message: Any) -> Iterator[tuple[str, Any]]:
    for field in message.get_fields_and_field_types():
        yield field, getattr(message, field)


def _zeroed_value(value: Any) -> Any:
    if isinstance(value, bool | str | bytes | Header):
        return copy.deepcopy(value)
    if isinstance(value, int | float):
        return type(value)(0)
    if isinstance(value, array):
        return array(value.typecode, bytes(len(value) * value.itemsize))
    if isinstance(value, np.ndarray):
        return np.zeros_like(value)
    if isinstance(value, list):
        return [_zeroed_value(item) for item in value]
    return zeroed(value)


def _non_finite(value: Any, name: str) -> Iterator[str]:
    if isinstance(value, float):
        if not math.isfinite(value):
            yield f"`{name}` is {value:g}"
    elif isinstance(value, array | np.ndarray):
        for place in np.flatnonzero(~np.isfinite(value)):
            yield f"`{name}[{place}]` is {value[place]:g}"
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _non_finite(item, f"{name}[{index}]")
    elif hasattr(value, "get_fields_and_field_types"):
        for field, inner in _fields(value):
            yield from _non_finite(inner, f"{name}.{field}" if name else field)
