"""The queue of what belongs to no lane: tasks and reentrant jobs, run by a lane that is free."""

import os
import threading
from collections import deque
from collections.abc import Mapping
from functools import partial

from rclpy.callback_groups import CallbackGroup

from obelisk_py.core.executors.lane import Handler, Job, Lane
from obelisk_py.core.executors.listeners import open_signal

__all__ = ["JobQueue"]


class JobQueue:
    """Jobs that no lane has begun yet, first come, first served."""

    group: CallbackGroup | None = None
    waits_for_group = False

    def __init__(self) -> None:
        self._jobs: deque[Job] = deque()
        self._closing = threading.Lock()
        self._signal_fd = open_signal()
        self._closed = False

    def put(self, job: Job) -> None:
        """Let a lane run the job."""
        self._jobs.append(job)
        self._signal()

    def handlers(self, lane: Lane) -> Mapping[int, Handler]:
        """The queue's one descriptor."""
        return {self._signal_fd: partial(self._run_one, lane)}

    def close(self) -> None:
        """Close the descriptor; jobs that come later are never run."""
        with self._closing:
            self._closed = True
            os.close(self._signal_fd)

    def _signal(self) -> None:
        with self._closing:
            if not self._closed:
                os.eventfd_write(self._signal_fd, 1)

    def _run_one(self, lane: Lane) -> bool:
        try:
            job = self._jobs.popleft()
        except IndexError:
            return False
        if self._jobs:
            # The job may take long: another lane that waits takes the next one.
            self._signal()
        return job(lane)
