"""Store the latest control, and write it to the actuators at each step.

Control messages may arrive on any thread. The latest valid message yields an array of nu controls
or a torque law, which the stepping thread writes to `data.ctrl`. Rejected and late messages are
reported. A message is rejected if it has the wrong length, contains a number that is not finite or
too large for MuJoCo, or has an older stamp than the applied control. A control with a zero stamp is
never late.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.command_watchdog import (
    ONLY_REJECTIONS,
    LastingRejection,
    RejectionLog,
    RejectionReport,
)
from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.messages import optional_message
from obelisk_py.core.sim.mujoco.actuators import (
    Actuators,
    Brake,
    JointTorques,
    TorqueLaw,
    has_gains,
    out_of_limits,
)
from obelisk_py.core.sim.mujoco.step_times import NS_PER_S

__all__ = [
    "CONTROL_FIELDS",
    "DEFAULT_LATENESS_S",
    "Control",
    "ControlInbox",
    "ControlWriter",
    "StampOrder",
    "WhenStale",
    "control_field",
    "make_inbox",
]

PDFeedForward: Any = optional_message("PDFeedForward")
DEFAULT_LATENESS_S: Final = 1.0
"""Age at which a control counts as late on arrival, unless the config sets one [s]."""
CONTROL_FIELDS: Final = ("u_mujoco", "u")
"""Control fields of a message, in order of preference."""
Control = NDArray[np.float64] | TorqueLaw
"""Controls of the actuators, shape (nu,), or a law for the torques of each step."""


class StampOrder:
    """Compares the stamps of controls with the latest one and with the clock."""

    def __init__(self, now_ns: Callable[[], int], lateness_s: float) -> None:
        """Start without a control.

        Args:
            now_ns: returns the time of the node's clock [ns].
            lateness_s: age at which a control is reported as late [s].
        """
        self._now_ns = now_ns
        self._lateness_s = lateness_s
        self._newest_ns = 0

    def restart(self) -> None:
        """Return to the state without a control."""
        self._newest_ns = 0

    def rejection(self, stamp_ns: int) -> str | None:
        """Return the reason to reject a control: a newer one was applied. None to accept it.

        If the latest stamp is ahead of the clock, stamps are ignored. In this case the clock jumped
        back, or the sender uses another clock.
        """
        if 0 < stamp_ns < self._newest_ns <= self._now_ns():
            return "its stamp is older than that of the applied control"
        return None

    def accept(self, stamp_ns: int) -> str | None:
        """Record a control as the latest; if it is late, return a description of this."""
        if stamp_ns == 0:
            return None
        self._newest_ns = stamp_ns
        if self._now_ns() - stamp_ns > self._lateness_s * NS_PER_S:
            return f"its stamp is more than {self._lateness_s:g} s old"
        return None


def control_field(message_type: type[Any]) -> str:
    """Return the field of a control message type that holds the actuators' controls.

    Raises:
        ObeliskConfigError: the type has no such field.
    """
    for field in CONTROL_FIELDS:
        if hasattr(message_type, field):
            return field
    raise ObeliskConfigError(
        f"the control message {message_type.__name__} has neither a field `u_mujoco` nor `u`, "
        "so the simulator cannot read the actuators' controls from it"
    )


class ControlInbox:
    """Stores the latest control; one thread may write it while another one reads it."""

    def __init__(
        self,
        *,
        field: str | None,
        size: int,
        monotonic_s: Callable[[], float],
        torques: JointTorques | None = None,
        stamps: StampOrder | None = None,
    ) -> None:
        """Create an empty inbox.

        Args:
            field: control field of the messages; None to choose it for each message.
            size: number of actuators `nu`.
            monotonic_s: clock that limits the rate of reports [s].
            torques: reads the gains of `PDFeedForward`; None for other messages.
            stamps: checks the messages' stamps; None to ignore them.
        """
        self._field = field
        self._size = size
        self._torques = torques
        self._stamps = stamps
        self._rejections = RejectionLog("control rejected", monotonic_s, ONLY_REJECTIONS)
        self._late = RejectionLog("late control applied", monotonic_s)
        self.newest: Control | None = None
        """The control to apply; None before the first one."""
        self.has_rejected = False
        """Whether the latest control was rejected; the robot may set it to False."""

    def clear(self) -> None:
        """Drop the latest control."""
        self.newest = None
        self._rejections.accept()
        if self._stamps is not None:
            self._stamps.restart()

    def offer(self, message: Any) -> bool:
        """Accept or reject a control message; returns whether it was accepted."""
        sent_ns = _sent_ns(message) if self._stamps is not None else 0
        control: Control | str | None = self._stamps.rejection(sent_ns) if self._stamps else None
        if control is None:
            control = self._read(message)
        return self._reject(control) if isinstance(control, str) else self._accept(control, sent_ns)

    def put(self, control: Iterable[float]) -> bool:
        """Accept or reject controls for the actuators; returns whether they were accepted."""
        checked = self._checked("ctrl", list(control))
        return self._reject(checked) if isinstance(checked, str) else self._accept(checked, 0)

    def _reject(self, reason: str) -> bool:
        self._rejections.add(reason)
        self.has_rejected = True
        return False

    def _accept(self, control: Control, sent_ns: int) -> bool:
        late = self._stamps.accept(sent_ns) if self._stamps is not None else None
        if late is not None:
            self._late.add(late)
        self._rejections.accept()
        self.newest = control
        self.has_rejected = False
        return True

    def reports(self, *, is_last: bool = False) -> list[RejectionReport]:
        """Return the reports that are due, each kind at most once per second, or the last ones."""
        reports = (self._rejections.report(is_last=is_last), self._late.report(is_last=is_last))
        return [report for report in reports if report is not None]

    def lasting_rejection(self) -> LastingRejection | None:
        """The rejections since the last accepted control; None if they span less than 1 s."""
        return self._rejections.lasting()

    def _read(self, message: Any) -> Control | str:
        """Return the control in a message, or the reason to reject it."""
        if self._torques is not None and isinstance(message, PDFeedForward) and has_gains(message):
            return self._torques.read(message)
        try:
            field = self._field or control_field(type(message))
        except ObeliskConfigError as error:
            return str(error)
        return self._checked(field, getattr(message, field))

    def _checked(self, field: str, numbers: Any) -> Control | str:
        control = np.array(numbers, dtype=np.float64, ndmin=1)
        if control.shape != (self._size,):
            return (
                f"`{field}` has the length {control.size}, expected {self._size} (one per actuator)"
            )
        return out_of_limits(field, control) or control


def make_inbox(
    message_type: Any | None,
    model: mujoco.MjModel,
    *,
    now_ns: Callable[[], int],
    lateness_s: float | None,
) -> ControlInbox:
    """Create an inbox for the controls of a model.

    Args:
        message_type: class of the control messages; None if each message may have its own class.
        model: the model to control.
        now_ns: returns the time to compare the messages' stamps with [ns].
        lateness_s: age at which a control is reported as late [s]; None for the default.

    Raises:
        ObeliskConfigError: the message type has no control field.
    """
    return ControlInbox(
        field=None if message_type is None else control_field(message_type),
        size=model.nu,
        monotonic_s=time.monotonic,
        torques=JointTorques(model) if message_type in (None, PDFeedForward) else None,
        stamps=StampOrder(now_ns, DEFAULT_LATENESS_S if lateness_s is None else lateness_s),
    )


def _sent_ns(message: Any) -> int:
    """Return the stamp of a message [ns]; 0 if it has none."""
    if not hasattr(message, "header"):
        return 0
    stamp = message.header.stamp
    return int(stamp.sec * NS_PER_S + stamp.nanosec)


@dataclass(frozen=True, slots=True, kw_only=True)
class WhenStale:
    """The response to stale commands."""

    action: str
    """One of `obelisk_spec.components.STALE_ACTIONS`."""
    is_stale: Callable[[], bool]
    """Returns whether the latest command is stale; called before each step."""


class ControlWriter:
    """Writes the controls of a simulation."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        inbox: ControlInbox,
        when_stale: WhenStale | None,
    ) -> None:
        """Write to `data`, from `inbox`."""
        self._model = model
        self._data = data
        self._inbox = inbox
        self._when_stale = when_stale
        self._actuators = Actuators(model)
        self._torques = JointTorques(model)
        self._ctrl = data.ctrl
        self._applied: object = None
        self._brake: Brake | None = None

    def restart(self) -> None:
        """Drop the controls; `data.ctrl` stays unchanged until a new one is written."""
        self._inbox.clear()
        self._applied = None
        self._brake = None

    def write(self) -> bool:
        """Write the next step's control; returns whether later steps can reuse it."""
        stale = self._when_stale
        if stale is not None and stale.is_stale() and stale.action != "hold":
            return self._write_safe(stale.action)
        self._brake = None
        control = self._inbox.newest
        if isinstance(control, TorqueLaw):
            self._ctrl[:] = self._torques.control(control, self._data)
            return False
        if control is not self._applied and control is not None:
            self._ctrl[:] = control
            self._applied = control
        return True

    def _write_safe(self, action: str) -> bool:
        if action == "zero":
            self._ctrl[:] = 0.0
            return True
        if self._brake is None:
            self._brake = Brake(self._actuators, self._model, self._data)
        self._ctrl[:] = self._brake.control(self._data.actuator_velocity)
        return False
