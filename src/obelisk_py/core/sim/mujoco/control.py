"""Hold the control that the simulation applies next, and write it to the actuators at each step.

In: control messages, on any thread. Out: an array of the actuators' size or a torque law, from the
newest valid message; reports of rejected and late messages; `data.ctrl`, on the thread that steps.
A message is rejected if it has the wrong length, a number that is not finite or too large for
MuJoCo, or a stamp older than that of the applied control. A control without a stamp (zero) is never
late.
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
"""Age at which an arriving control is reported as late, unless the config sets one [s]."""
CONTROL_FIELDS: Final = ("u_mujoco", "u")
"""Fields of a control message that the simulator reads, the first that the type has."""
Control = NDArray[np.float64] | TorqueLaw
"""The actuators' controls, shape (nu,), or a law for the torques of each step."""


class StampOrder:
    """The stamp of the newest control."""

    def __init__(self, now_ns: Callable[[], int], lateness_s: float) -> None:
        """Start without a control.

        Args:
            now_ns: the node's clock [ns].
            lateness_s: age at which a control is reported as late [s].
        """
        self._now_ns = now_ns
        self._lateness_s = lateness_s
        self._newest_ns = 0

    def restart(self) -> None:
        """Return to the state without a control."""
        self._newest_ns = 0

    def rejection(self, stamp_ns: int) -> str | None:
        """The reason to reject a control: a newer one was applied.

        Stamps are ignored if the newest one is ahead of the clock: the clock was set back, or it is
        not the sender's.
        """
        if 0 < stamp_ns < self._newest_ns <= self._now_ns():
            return "it is older than the one applied, by their stamps"
        return None

    def accept(self, stamp_ns: int) -> str | None:
        """Accept a control as the newest; returns a sentence if it is late."""
        if stamp_ns == 0:
            return None
        self._newest_ns = stamp_ns
        if self._now_ns() - stamp_ns > self._lateness_s * NS_PER_S:
            return f"its stamp is more than {self._lateness_s:g} s old"
        return None


def control_field(message_type: type[Any]) -> str:
    """The field of a control message type that holds what the actuators get.

    Raises:
        ObeliskConfigError: it has none.
    """
    for field in CONTROL_FIELDS:
        if hasattr(message_type, field):
            return field
    raise ObeliskConfigError(
        f"the control message {message_type.__name__} has neither a field `u_mujoco` nor `u`, "
        "so the simulator cannot read what to write to the actuators"
    )


class ControlInbox:
    """Holds the newest control; may be filled on one thread and read on another."""

    def __init__(
        self,
        *,
        field: str | None,
        size: int,
        monotonic_s: Callable[[], float],
        torques: JointTorques | None = None,
        stamps: StampOrder | None = None,
    ) -> None:
        """Make an empty inbox.

        Args:
            field: field of the messages that holds the control; None: of each message its own.
            size: number of actuators `nu`.
            monotonic_s: clock for the rate of reports [s].
            torques: reads the gains of `PDFeedForward`; None for other messages.
            stamps: checks the messages' stamps; None: they are ignored.
        """
        self._field = field
        self._size = size
        self._torques = torques
        self._stamps = stamps
        self._rejections = RejectionLog("control rejected", monotonic_s, ONLY_REJECTIONS)
        self._late = RejectionLog("late control applied", monotonic_s)
        self.newest: Control | None = None
        """The control to apply; None until there is one."""

    def clear(self) -> None:
        """Forget the newest control."""
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
        if isinstance(control, str):
            self._rejections.add(control)
            return False
        return self._accept(control, sent_ns)

    def put(self, control: Iterable[float]) -> bool:
        """Accept or reject numbers for the actuators; returns whether they were accepted."""
        checked = self._checked("ctrl", list(control))
        if isinstance(checked, str):
            self._rejections.add(checked)
            return False
        return self._accept(checked, 0)

    def _accept(self, control: Control, sent_ns: int) -> bool:
        late = self._stamps.accept(sent_ns) if self._stamps is not None else None
        if late is not None:
            self._late.add(late)
        self._rejections.accept()
        self.newest = control
        return True

    def reports(self) -> list[RejectionReport]:
        """Reports that are not logged yet, each kind at most once per second."""
        reports = (self._rejections.report(), self._late.report())
        return [report for report in reports if report is not None]

    def lasting_rejection(self) -> LastingRejection | None:
        """The rejections since a control was accepted."""
        return self._rejections.lasting()

    def _read(self, message: Any) -> Control | str:
        """The control of a message, or the reason to reject it."""
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
            return f"`{field}` has the length {control.size}, the model takes {self._size}"
        return out_of_limits(field, control) or control


def make_inbox(
    message_type: Any | None,
    model: mujoco.MjModel,
    *,
    now_ns: Callable[[], int],
    lateness_s: float | None,
) -> ControlInbox:
    """An inbox for the controls of a model.

    Args:
        message_type: class of the control messages; None: any, each with a field of its own.
        model: the model to control.
        now_ns: the clock that the messages' stamps are compared with [ns].
        lateness_s: age at which a control is reported as late [s]; None: the default.

    Raises:
        ObeliskConfigError: the message has no field for the actuators.
    """
    return ControlInbox(
        field=None if message_type is None else control_field(message_type),
        size=model.nu,
        monotonic_s=time.monotonic,
        torques=JointTorques(model) if message_type in (None, PDFeedForward) else None,
        stamps=StampOrder(now_ns, DEFAULT_LATENESS_S if lateness_s is None else lateness_s),
    )


def _sent_ns(message: Any) -> int:
    """The stamp of a message [ns]; 0 if it has none."""
    if not hasattr(message, "header"):
        return 0
    stamp = message.header.stamp
    return int(stamp.sec * NS_PER_S + stamp.nanosec)


@dataclass(frozen=True, slots=True, kw_only=True)
class WhenStale:
    """The action on commands that are too old."""

    action: str
    """One of `obelisk_spec.components.STALE_ACTIONS`."""
    is_stale: Callable[[], bool]
    """Returns whether the newest command is too old; called before each step."""


class ControlWriter:
    """Writes the controls of one simulation."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        inbox: ControlInbox,
        when_stale: WhenStale | None,
    ) -> None:
        """Take what it reads from and writes to."""
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
        """Forget the controls; `data.ctrl` stays until a new one is written."""
        self._inbox.clear()
        self._applied = None
        self._brake = None

    def write(self) -> bool:
        """Write the next step's control; returns whether the steps after it have the same one."""
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
