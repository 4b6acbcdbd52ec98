"""Lower the priority of threads that draw, so that they do not delay the control loops."""

import os
from typing import Final

from obelisk_py.core.time_slice import reset_time_slice

__all__ = ["lower_priority"]

NICENESS: Final = 10
"""Added to the niceness of the stack; the system limits the sum to 19."""
CALLING_THREAD: Final = 0


def lower_priority(thread: int = CALLING_THREAD) -> None:
    """Give a thread a lower priority than the robot's, and make it an ordinary one.

    A stack that is started with real-time priority (`chrt`) passes it on to all its processes, and
    niceness has no effect on real-time threads. A node passes on its short time slices, too.

    Args:
        thread: the id of a thread of this process; threads that it creates later inherit the
            priority.
    """
    os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))
    reset_time_slice(thread)
    niceness = os.getpriority(os.PRIO_PROCESS, thread) + NICENESS
    os.setpriority(os.PRIO_PROCESS, thread, niceness)
