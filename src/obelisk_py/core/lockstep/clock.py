"""The clock of all nodes of a lock-step run, in place of every clock that a node may have."""

from typing import Any, cast

from rclpy.clock import Clock, ROSClock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.time import Time

from obelisk_py.core.lockstep.guest_thread import take_time
from obelisk_py.core.lockstep.scheduler import NS_PER_S, Scheduler

__all__ = ["LockstepClock", "make_clock"]


class LockstepClock(ROSClock):
    """A clock that shows the time of a scheduler."""

    scheduler: Scheduler

    def now(self) -> Time:
        """The simulated time."""
        return Time(nanoseconds=self.scheduler.time_ns, clock_type=ClockType.ROS_TIME)

    def sleep_until(self, until: Time, context: Context | None = None) -> bool:
        """Let the running callback take time until then; always true.

        Raises:
            ValueError: `until` is of another type of clock.
        """
        del context
        if until.clock_type != self.clock_type:
            raise ValueError("until's clock type does not match this clock's type")
        left_ns = until.nanoseconds - self.scheduler.time_ns
        if left_ns > 0:
            take_time(self.scheduler, left_ns / NS_PER_S)
        return True

    @property
    def ros_time_is_active(self) -> bool:
        """True: the time is simulated."""
        return True


def make_clock(scheduler: Scheduler) -> LockstepClock:
    """The clock of a scheduler."""
    # rclpy's constructor chooses the class by the type of the clock.
    clock = cast(Any, Clock(clock_type=ClockType.ROS_TIME))
    clock.__class__ = LockstepClock
    clock.scheduler = scheduler
    return cast(LockstepClock, clock)
