"""`ObeliskRobot` and `ObeliskSimRobot`: the system that is controlled, real or simulated."""

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, Final

from obelisk_sensor_msgs.msg import TrueSimState
from rclpy.lifecycle import LifecycleState
from rclpy.subscription import Subscription

from obelisk_py.core.command_age import CommandAge, StalePolicy
from obelisk_py.core.components import Component
from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError
from obelisk_py.core.lookout import Lookout
from obelisk_py.core.message_numbers import non_finite_number, zeroed
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.obelisk_typing import ObeliskControlMsg
from obelisk_py.core.refusals import REFUSED_ON_END, Refusals, Report
from obelisk_py.core.settings import stale_policy
from obelisk_py.core.silences import GRACE_S, Silences
from obelisk_spec.components import CONTROL_SUBSCRIPTION

__all__ = ["ObeliskRobot", "ObeliskSimRobot"]

LONGEST_STOP_S = 5.0
"""How long `run_simulator`, or a robot's action on old commands, may take to return [s]."""

_TOLD: Final = {
    "zero": "every number of the control is set to zero",
    "hold": "the last one stays",
    "damp": "the robot brakes",
}


class ObeliskRobot(ABC, ObeliskNode):
    """Base of robots.

    Registers the subscription `sub_ctrl` -> `apply_control` with the ROS parameter
    `sub_ctrl_setting`. The inheriting class registers its sensors' publishers.

    With `max_age_sec` in the settings of that subscription, what `stale_action` says is done when
    no command was accepted for so long, by the steady clock, whatever the executor is busy with.
    """

    def __init__(
        self, node_name: str, ctrl_msg_type: type[Any] | None = None, **kwargs: Any
    ) -> None:
        """Make the node and register the control subscription.

        Args:
            node_name: name in the ROS graph, where no remapping gives another.
            ctrl_msg_type: class of the control message; without it the config names the type.
            kwargs: handed to `rclpy.node.Node`.
        """
        super().__init__(node_name, **kwargs)
        self._age: CommandAge | None = None
        self._silences = Silences()
        self._lookout: Lookout | None = None
        self._newest_control: Any = None
        self._refused_controls = Refusals("control refused", time.monotonic, REFUSED_ON_END)
        # apply_control has one caller at a time: the executor's thread or the lookout's.
        self._applying = threading.Lock()
        # The key is written out: `obk validate` reads constructors, it does not run them.
        self.register_obk_subscription(
            "sub_ctrl_setting", self._take_control, key="sub_ctrl", msg_type=ctrl_msg_type
        )

    @abstractmethod
    def apply_control(self, control_msg: ObeliskControlMsg) -> bool | None:
        """Apply a control message to the system; called only while the node is active.

        Called on the executor's thread, or with `max_age_sec` on another, never on both at once.

        Args:
            control_msg: the newest control.

        Returns:
            False if it was refused, so that it does not count as a command; else nothing.
        """

    def apply_damping(self) -> None:
        """Brake, because no command has come for too long; called once, until one comes again.

        With `stale_action: damp`, instead of `apply_control` and under the same lock.

        Raises:
            ObeliskConfigError: the inheriting class does not implement it.
        """
        raise ObeliskConfigError(
            f"{type(self).__name__} does not implement apply_damping, "
            "but the config sets `stale_action: damp`"
        )

    def _take_control(self, control_msg: ObeliskControlMsg) -> None:
        # A robot that is not active must not move, whoever still publishes.
        if self.state_label != "active":
            return
        if self._age is None:
            self.apply_control(control_msg)
            return
        refusal = self._refusal_of(control_msg)
        if refusal is not None:
            self._refused_controls.add(refusal)
            told = self._refused_controls.report()
            if told is not None:
                self._tell_refusal(told)
            return
        with self._applying:
            if self.apply_control(control_msg) is False:
                return
            self._newest_control = control_msg
            was_idle = self._age.deadline_s is None
            silent_s = self._age.accept(time.monotonic())
        self._refused_controls.accept()
        if was_idle and self._lookout is not None:
            self._lookout.wake()
        if silent_s is not None and self._silences.end(silent_s):
            self.get_logger().warning(f"commands come again, after {silent_s:.3f} s without")

    def _refusal_of(self, control_msg: ObeliskControlMsg) -> str | None:
        """Why a command is kept from `apply_control` and does not count."""
        return non_finite_number(control_msg)

    def _can_damp(self) -> bool:
        return type(self).apply_damping is not ObeliskRobot.apply_damping

    def _tell_refusal(self, report: Report) -> None:
        # Two calls: rclpy lets no call change its severity from one time to the next.
        if report.is_lasting:
            self.get_logger().error(report.text)
        else:
            self.get_logger().warning(report.text)

    def _is_stale(self) -> bool:
        """Whether the newest command is too old by now."""
        assert self._age is not None
        self._becomes_stale()
        return self._age.is_stale

    def _becomes_stale(self) -> bool:
        """Whether the newest command has just become too old; tells of silences when it is time."""
        assert self._age is not None
        now_s = time.monotonic()
        is_new = self._age.look(now_s) is not None
        if is_new:
            self._silences.begin(now_s)
        due_s = self._silences.due_s
        if due_s is not None and now_s >= due_s:
            self._tell_silence(now_s)
        return is_new

    def _tell_silence(self, now_s: float) -> None:
        assert self._age is not None
        silent_s, policy = self._age.silence_s(now_s), self._age.policy
        text = (
            f"{self._silences.report(now_s, silent_s)}, more than `max_age_sec` of "
            f"{policy.max_age_s:g} s: {_TOLD[policy.action]} (`stale_action: {policy.action}`)"
        )
        if self._lookout is not None and self._applying.locked():
            text += "; apply_control has not returned, which holds that up"
        topic = self.obk_subscriptions[CONTROL_SUBSCRIPTION].topic_name
        if silent_s is not None and self.count_publishers(topic) == 0:
            # A controller that was ended, in order perhaps; of one that crashed its launcher tells.
            self.get_logger().warning(f"{text}; nobody publishes {topic} any more")
        else:
            self.get_logger().error(text)

    def _act_if_stale(self) -> None:
        if self._becomes_stale():
            self.guarded(self._act_on_old_commands)()

    def _act_on_old_commands(self) -> None:
        # A call of apply_control that hangs is told of while it is waited for.
        while not self._applying.acquire(timeout=GRACE_S):
            if not self._has_to_act():
                return
            self._becomes_stale()
        try:
            if self._has_to_act():
                self._make_safe()
        finally:
            self._applying.release()

    def _has_to_act(self) -> bool:
        """False once a command has come meanwhile, or the node is on its way down."""
        assert self._age is not None
        return self._age.is_stale and self.state_label == "active"

    def _make_safe(self) -> None:
        assert self._age is not None
        if self._age.policy.action == "zero":
            control = zeroed(self._newest_control)
            if hasattr(control, "header"):
                control.header.stamp = self.get_clock().now().to_msg()
            self.apply_control(control)
        elif self._age.policy.action == "damp":
            self.apply_damping()

    def _subscription(self, component: Component, raw: Mapping[str, Any]) -> Subscription:
        if component.key == CONTROL_SUBSCRIPTION:
            self._age = self._age_of(stale_policy(component, raw))
        return super()._subscription(component, raw)

    def _age_of(self, policy: StalePolicy | None) -> CommandAge | None:
        if policy is None:
            return None
        if policy.action == "damp" and not self._can_damp():
            self.apply_damping()  # the one that says what is missing
        return CommandAge(policy)

    def _start(self) -> None:
        super()._start()
        self._look_out()

    def _hold(self, state: LifecycleState) -> None:
        self._stop_lookout()
        super()._hold(state)

    def destroy_node(self) -> None:
        """Stop the lookout before what it may act on goes; one that goes on is told of."""
        try:
            self._stop_lookout()
        except ObeliskError as error:
            self.get_logger().error(str(error))
        super().destroy_node()

    def _look_out(self) -> None:
        if self._age is not None and self._lookout is None:
            self._forget_commands()
            self._lookout = Lookout(self._next_look_s, self._act_if_stale)
            self._lookout.start()

    def _next_look_s(self) -> float | None:
        assert self._age is not None
        times_s = (self._age.deadline_s, self._silences.due_s)
        return min((time_s for time_s in times_s if time_s is not None), default=None)

    def _forget_commands(self) -> None:
        """Begin with no command again."""
        self._refused_controls.accept()
        self._silences.forget()
        if self._age is not None:
            self._age.forget()

    def _stop_lookout(self) -> None:
        if self._lookout is None:
            return
        if not self._lookout.stop(LONGEST_STOP_S):
            raise ObeliskError(
                f"the robot's action on old commands went on for {LONGEST_STOP_S:g} s after "
                "it was to stop"
            )
        self._lookout = None


class ObeliskSimRobot(ObeliskRobot):
    """Base of simulated robots.

    Registers, both optional, the timer `timer_true_sim_state` -> `publish_true_sim_state` and the
    publisher `pub_true_sim_state`. While the node is active, `run_simulator` runs in a thread of
    its own.
    """

    def __init__(
        self, node_name: str, ctrl_msg_type: type[Any] | None = None, **kwargs: Any
    ) -> None:
        """Make the node and register its components.

        Args:
            node_name: name in the ROS graph, where no remapping gives another.
            ctrl_msg_type: class of the control message; without it the config names the type.
            kwargs: handed to `rclpy.node.Node`.
        """
        super().__init__(node_name, ctrl_msg_type, **kwargs)
        self.simulator_stop = threading.Event()
        """Set when `run_simulator` is to return."""
        self._simulator: threading.Thread | None = None
        self._is_deaf = False
        """Whether `run_simulator` went on when it was to return; it is waited for only once."""
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

    @abstractmethod
    def run_simulator(self) -> None:
        """Step the simulation until `simulator_stop` is set; what it raises fails the node.

        Each run has an event of its own: take `self.simulator_stop` once, at the beginning.
        """

    def publish_true_sim_state(self) -> TrueSimState:
        """Publish the simulator's own state on `pub_true_sim_state`, and return it.

        Raises:
            ObeliskConfigError: the inheriting class has no such state, yet the config asks for it.
        """
        raise ObeliskConfigError(
            f"{type(self).__name__} does not implement publish_true_sim_state, "
            "but the config sets timer_true_sim_state"
        )

    def destroy_node(self) -> None:
        """Stop the simulator's thread before the publishers go; one that goes on is told of."""
        try:
            self._stop_simulator()
        except ObeliskError as error:
            self.get_logger().error(str(error))
        super().destroy_node()

    def _start(self) -> None:
        super()._start()
        if self._simulator is None:
            # A stop of its own for each run, so that an old one cannot come back to life.
            self.simulator_stop = threading.Event()
            self._simulator = threading.Thread(
                target=self._simulate, args=[self.simulator_stop], name="simulator", daemon=True
            )
            self._simulator.start()

    def _simulate(self, stop: threading.Event) -> None:
        self.guarded(self.run_simulator)()
        if not (stop.is_set() or self.is_failing()):
            self.get_logger().warning(
                "run_simulator has returned although simulator_stop is not set: it steps no more"
            )

    def _hold(self, state: LifecycleState) -> None:
        self._stop_simulator()
        super()._hold(state)

    def _stop_simulator(self) -> None:
        self.simulator_stop.set()
        if self._simulator is None:
            return
        self._simulator.join(0 if self._is_deaf else LONGEST_STOP_S)
        self._is_deaf = self._simulator.is_alive()
        if self._is_deaf:
            raise ObeliskError(
                f"run_simulator went on for {LONGEST_STOP_S:g} s after simulator_stop was set"
            )
        self._simulator = None
