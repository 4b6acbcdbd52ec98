"""Lanes, roster and auxiliary thread, put together; started, paused and stopped as one.

The first lane is run by whoever spins. With more than one, the others have threads of their own,
which run while somebody spins and rest otherwise.
"""

import threading
import time

from rclpy.context import Context

from obelisk_py.core.executors.auxiliary import AuxiliaryThread
from obelisk_py.core.executors.entities import ExecutorReference
from obelisk_py.core.executors.jobs import JobQueue
from obelisk_py.core.executors.lane import Lane
from obelisk_py.core.executors.roster import Roster

__all__ = ["Engine"]


class Engine:
    """What runs under an executor."""

    def __init__(
        self,
        num_threads: int,
        context: Context,
        executor: ExecutorReference,
    ) -> None:
        """Put the parts together; nothing runs yet.

        Args:
            num_threads: lanes.
            context: whose end is watched.
            executor: whose nodes are run; None when it is not in use any more.
        """
        self.spinning = threading.Lock()
        """Held by the thread that spins."""
        self.is_stopped = False
        self.fault: BaseException | None = None
        """What a callback raised on a lane other than the first, or what ended the auxiliary."""
        self.jobs = JobQueue()
        self._is_closed = False
        self._executor = executor
        self._lanes = tuple(Lane() for _ in range(num_threads))
        for lane in self._lanes:
            lane.add(self.jobs, shared=num_threads > 1)
        self._auxiliary = AuxiliaryThread(context, self._on_event)
        self._roster = Roster(self._lanes, self.jobs, self._auxiliary, executor)
        self._gate = threading.Event()
        self._threads: tuple[threading.Thread, ...] = ()

    @property
    def lane(self) -> Lane:
        """The lane of the thread that spins."""
        return self._lanes[0]

    def call(self, *, entities_changed: bool) -> None:
        """Let all lanes come to `attend`."""
        if entities_changed:
            self._roster.is_outdated = True
        for lane in self._lanes:
            lane.call()

    def attend(self, lane: Lane) -> bool:
        """What a lane does when it was called; true if a callback of the user ran."""
        if self._roster.is_outdated:
            self._update()
        return lane.attend()

    def settle(self) -> None:
        """Follow a change of the nodes at once if nobody spins; if somebody does, he will."""
        with self._roster.lock:
            if self.lane.thread_id is None and not self.is_stopped:
                self._update()

    def start(self) -> None:
        """The calling thread, which holds `spinning`, becomes the first lane's."""
        self._own(self.lane)
        self.lane.attention = True
        if self.is_stopped:
            return
        self._auxiliary.start()
        if len(self._lanes) > 1 and not self._threads:
            self._threads = tuple(
                threading.Thread(target=self._work, args=(lane,), name=f"lane {n}", daemon=True)
                for n, lane in enumerate(self._lanes[1:], start=1)
            )
            for thread in self._threads:
                thread.start()
        self._gate.set()

    def pause(self) -> None:
        """The calling thread leaves; lanes with threads of their own rest after their callback."""
        self._gate.clear()
        for lane in self._lanes[1:]:
            lane.call()
        self._disown(self.lane)

    def stop(self, timeout_s: float | None) -> bool:
        """End all threads and let go of everything; false if that takes longer than `timeout_s`.

        From within a callback it only asks for the end, which comes when the callback is over.
        """
        self.is_stopped = True
        self._gate.set()
        self.call(entities_changed=False)
        if threading.get_ident() in [lane.thread_id for lane in self._lanes]:
            return True
        end_s = None if timeout_s is None else time.monotonic() + timeout_s
        if not self.spinning.acquire(timeout=-1 if timeout_s is None else timeout_s):
            return False
        try:
            return self.close(end_s)
        finally:
            self.spinning.release()

    def close(self, end_s: float | None = None) -> bool:
        """Let go of everything, by the thread that holds `spinning`, once stopped.

        Args:
            end_s: do not wait for threads beyond this time of the monotonic clock [s].

        Returns:
            Whether all threads had ended.
        """
        for thread in self._threads:
            thread.join(_left_s(end_s))
        if any(thread.is_alive() for thread in self._threads):
            return False
        if not self._is_closed:
            if not self._auxiliary.stop(_left_s(end_s)):
                return False
            self._is_closed = True
            self._roster.clear()
            for lane in self._lanes:
                lane.remove(self.jobs)
                lane.close()
            self.jobs.close()
        return True

    def _update(self) -> None:
        executor = self._executor()
        self._roster.update(executor.get_nodes() if executor is not None else ())

    def _work(self, lane: Lane) -> None:
        while not self.is_stopped:
            self._gate.wait()
            self._own(lane)
            try:
                while self._gate.is_set() and not self.is_stopped:
                    if lane.attention:
                        lane.attention = False
                        self.attend(lane)
                    lane.run_ready(-1)
            except BaseException as fault:  # whoever spins raises it
                lane.attention = True
                self._on_event(fault)
            finally:
                self._disown(lane)

    def _own(self, lane: Lane) -> None:
        with self._roster.lock:
            lane.thread_id = threading.get_ident()

    def _disown(self, lane: Lane) -> None:
        with self._roster.lock:
            lane.thread_id = None
            self._roster.let_leave(lane)

    def _on_event(self, fault: BaseException | None) -> None:
        self.fault = self.fault or fault
        self.lane.call()


def _left_s(end_s: float | None) -> float | None:
    return None if end_s is None else max(0.0, end_s - time.monotonic())
