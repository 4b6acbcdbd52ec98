"""A life-cycle node that tells what went wrong and survives it.

rclpy's own swallows what a transition callback raises, dies of a transition that is not allowed,
and is left half-way by a callback that returns nothing. Here each of these is logged, kept (the
service `~/last_error` tells the newest) and ends in a defined state.
Source: https://design.ros2.org/articles/node_lifecycle.html (states, transitions, errors).
"""

import functools
import inspect
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.task import Future
from std_srvs.srv import Trigger

from obelisk_py.core.exceptions import ObeliskError

__all__ = ["Fault", "GuardedLifecycleNode"]

TransitionCallback = Callable[[LifecycleState], TransitionCallbackReturn]

SUCCESS = TransitionCallbackReturn.SUCCESS
ERROR = TransitionCallbackReturn.ERROR
NO_TRANSITION = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """What a node died of, or nearly."""

    where: str
    """The callback that failed, by its name in the code."""
    text: str
    """One sentence."""
    traceback: str
    """The Python traceback, empty where the fault was no exception."""

    def __str__(self) -> str:
        return f"{self.where}: {self.text}" + (f"\n{self.traceback}" if self.traceback else "")


class GuardedLifecycleNode(LifecycleNode):
    """An rclpy life-cycle node whose failures are logged, kept, and lead to error processing."""

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        """Make the node and its services.

        Args:
            node_name: name in the ROS graph, where no remapping gives another.
            kwargs: handed to `rclpy.node.Node`.
        """
        super().__init__(node_name, **kwargs)
        self.last_fault: Fault | None = None
        self.ended: Future = Future()
        """Done when nothing further can be done with this node (finalized by a fault)."""
        self._fault_lock = threading.Lock()
        self._fault_pending = False
        self._unrecoverable = False
        # rclpy has no door for this: the callbacks that it calls by state stand in this table.
        self._callbacks = {
            state: self._guarded_transition(callback) for state, callback in self._callbacks.items()
        }
        self._service_change_state.callback = self._on_change_state
        self._last_error_service = self.create_service(Trigger, "~/last_error", self._on_last_error)

    @property
    def state_label(self) -> str:
        """The life-cycle state: `unconfigured`, `inactive`, `active`, `finalized`, ..."""
        return str(self._state_machine.current_state[1])

    def fail(self, fault: BaseException | str, where: str = "node") -> None:
        """Take the node to error processing; may be called from any thread.

        The fault is logged with its traceback and kept. What follows happens on the executor's
        thread; callbacks that come before it are dropped.

        Args:
            fault: the exception, or a sentence.
            where: what failed, for the message.
        """
        self._keep(fault, where)
        with self._fault_lock:
            if self._fault_pending:
                return
            self._fault_pending = True
        if self.executor is None:
            self._enter_error_processing()
        else:
            self.executor.create_task(self._enter_error_processing)

    def guarded(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """The same callback, but what it raises takes the node to error processing."""
        where = getattr(callback, "__qualname__", repr(callback))

        if inspect.iscoroutinefunction(callback):

            @functools.wraps(callback)
            async def wait(*args: Any) -> Any:
                if self._fault_pending:
                    return None
                try:
                    return await callback(*args)
                except Exception as error:
                    self.fail(error, where)

            return wait

        @functools.wraps(callback)
        def call(*args: Any) -> Any:
            if self._fault_pending:
                return None
            try:
                return callback(*args)
            except Exception as error:
                self.fail(error, where)

        return call

    def _keep(self, fault: BaseException | str, where: str) -> None:
        if isinstance(fault, BaseException):
            # What is wrong with the settings stands in the sentence, not in the library's code.
            is_ours = isinstance(fault, ObeliskError)
            trace = "" if is_ours else "".join(traceback.format_exception(fault)).rstrip()
            text = str(fault) if is_ours else f"{type(fault).__name__}: {fault}"
        else:
            trace, text = "", fault
        self.last_fault = Fault(where=where, text=text, traceback=trace)
        self.get_logger().error(str(self.last_fault))

    def _guarded_transition(self, callback: TransitionCallback) -> TransitionCallback:
        where = callback.__name__
        failed = TransitionCallbackReturn.FAILURE if where == "on_error" else ERROR

        def call(state: LifecycleState) -> TransitionCallbackReturn:
            if self._fault_pending and where != "on_error":
                return ERROR
            result = attempt(state)
            self._unrecoverable = where == "on_error" and result != SUCCESS
            return result

        def attempt(state: LifecycleState) -> TransitionCallbackReturn:
            try:
                result = callback(state)
            except Exception as error:
                self._keep(error, where)
                return failed
            if not isinstance(result, TransitionCallbackReturn):
                self._keep(
                    f"returned {result!r}, expected a TransitionCallbackReturn "
                    "(did the callback forget its return statement?)",
                    where,
                )
                return failed
            if result != SUCCESS:
                self._keep(f"returned {result.name}", where)
            elif where == "on_configure":
                self.last_fault = None
            return result

        return call

    def _enter_error_processing(self) -> None:
        # The state machine has no edge from a resting state to error processing, so a transition
        # is begun whose callback answers ERROR at once (see _guarded_transition).
        begin = {"active": self.trigger_deactivate, "inactive": self.trigger_cleanup}
        try:
            if self.state_label in begin:
                begin[self.state_label]()
        finally:
            with self._fault_lock:
                self._fault_pending = False
        self._end_if_unrecoverable()

    def _end_if_unrecoverable(self) -> None:
        if self._unrecoverable and not self.ended.done():
            self.ended.set_result(self.last_fault)

    def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        wanted = request.transition
        allowed = {
            edge[0]: edge[1]
            for edge in self._state_machine.available_transitions
            if edge[0] in self._triggers
        }
        by_label = {label: number for number, label in allowed.items()}
        number = by_label.get(wanted.label, NO_TRANSITION) if wanted.label else int(wanted.id)
        if number not in allowed:
            self.get_logger().warning(
                f"refused the transition '{wanted.label or wanted.id}' in the state "
                f"'{self.state_label}'; possible here: {', '.join(by_label) or 'none'}"
            )
            response.success = False
            return response
        response.success = self._triggers[number]() == SUCCESS
        self._end_if_unrecoverable()
        return response

    @functools.cached_property
    def _triggers(self) -> dict[int, Callable[[], TransitionCallbackReturn]]:
        return {
            Transition.TRANSITION_CONFIGURE: self.trigger_configure,
            Transition.TRANSITION_CLEANUP: self.trigger_cleanup,
            Transition.TRANSITION_ACTIVATE: self.trigger_activate,
            Transition.TRANSITION_DEACTIVATE: self.trigger_deactivate,
            Transition.TRANSITION_UNCONFIGURED_SHUTDOWN: self.trigger_shutdown,
            Transition.TRANSITION_INACTIVE_SHUTDOWN: self.trigger_shutdown,
            Transition.TRANSITION_ACTIVE_SHUTDOWN: self.trigger_shutdown,
        }

    def _on_last_error(
        self, _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        response.success = self.last_fault is not None
        response.message = "" if self.last_fault is None else str(self.last_fault)
        return response
