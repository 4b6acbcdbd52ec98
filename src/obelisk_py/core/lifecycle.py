"""A lifecycle node that reports its failures and recovers from them.

rclpy's lifecycle node swallows exceptions of transition callbacks, crashes on a disallowed
transition, and ends in an undefined state if a callback returns nothing. This node logs and keeps
each of these failures (the `~/last_error` service returns the latest one) and always ends in a
defined state. What runs depends only on the state in which a transition ended. An override that
forgets a step cannot change that.
Source: https://design.ros2.org/articles/node_lifecycle.html (states, transitions, errors).
"""

import functools
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.client import Client
from rclpy.guard_condition import GuardCondition
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Rate, Timer
from std_srvs.srv import Trigger

from obelisk_py.core.faults import (
    NodeFault,
    fault_of,
    guard_callback,
    guard_service,
    wrong_answer,
)
from obelisk_py.core.live_parameters import LiveParameters
from obelisk_py.core.parameter_rules import (
    SETTING_SERVICES,
    GuardedCheck,
    ParameterRules,
    guard_setting_service,
)
from obelisk_py.core.shared_clock import ClockFeed
from obelisk_py.core.surroundings import current_surroundings

__all__ = ["GuardedLifecycleNode", "NodeFault", "node_arguments"]

TransitionCallback = Callable[[LifecycleState], TransitionCallbackReturn]

SUCCESS = TransitionCallbackReturn.SUCCESS
ERROR = TransitionCallbackReturn.ERROR
NO_TRANSITION = -1

_own_arguments: ContextVar[tuple[str, ...] | None] = ContextVar("own_arguments", default=None)


@contextmanager
def node_arguments(arguments: Sequence[str]) -> Iterator[None]:
    """Inside the `with` block, new nodes use these ROS arguments instead of the process's.

    Many node classes accept no keyword arguments that they could pass to rclpy.
    """
    token = _own_arguments.set(tuple(arguments))
    try:
        yield
    finally:
        _own_arguments.reset(token)


class GuardedLifecycleNode(LifecycleNode):
    """An rclpy lifecycle node; a failure is logged, kept, and starts error processing."""

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        """Create the node and its services.

        Args:
            node_name: name in the ROS graph, unless it is remapped.
            kwargs: passed to `rclpy.node.Node`.
        """
        self.last_fault: NodeFault | None = None
        self.ended: Future = Future()
        """Done when the node cannot continue; the result is its fault, if any."""
        # One transition at a time, with any executor; a fault waits until the transition ends.
        self._transition_lock = threading.RLock()
        self._is_failing = False
        self._is_unrecoverable = False
        self.surroundings = current_surroundings()
        self.live_parameters = LiveParameters(self)
        own = _own_arguments.get()
        if own is not None:
            kwargs = {"cli_args": list(own), "use_global_arguments": False, **kwargs}
        with self.surroundings.construction(self):
            super().__init__(node_name, **kwargs)
        # rclpy offers no method for this; it calls the callbacks in this table, by state.
        self._callbacks = {
            state: self._guarded_transition(callback) for state, callback in self._callbacks.items()
        }
        self._service_change_state.callback = self._on_change_state
        self._parameter_rules = ParameterRules(self, lambda: self.state_label)
        self.live_parameters.declare()
        self._last_error_service = self.create_service(Trigger, "~/last_error", self._on_last_error)

    @property
    def state_label(self) -> str:
        """The lifecycle state: `unconfigured`, `inactive`, `active`, `finalized`, ..."""
        return str(self._state_machine.current_state[1])

    def is_failing(self) -> bool:
        """Whether a fault is waiting for error processing."""
        return self._is_failing

    def fail(self, cause: BaseException | str, where: str = "node") -> None:
        """Start error processing; thread-safe.

        The fault is logged and kept. Error processing runs on the executor's thread, after any
        transition in progress. Callbacks due before it are dropped.

        Args:
            cause: the exception, or a message.
            where: the part that failed, for the log message.
        """
        self._keep_fault(cause, where)
        if self._is_failing:
            return
        self._is_failing = True
        if self.executor is not None:
            self.executor.create_task(self._enter_error_processing)
        elif self._transition_lock.acquire(blocking=False):
            # Otherwise another thread is in a transition and may be waiting for this thread to end.
            try:
                self._enter_error_processing()
            finally:
                self._transition_lock.release()

    def guarded(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a callback, so that an exception starts error processing."""
        return guard_callback(self.live_parameters.around(callback), self.is_failing, self.fail)

    def create_lifecycle_publisher(self, *args: Any, **kwargs: Any) -> LifecyclePublisher:
        """Like rclpy's, but messages bypass DDS if only processes of the run subscribe."""
        # Does not use rclpy's method, which cannot set the class.
        make: Any = self.surroundings.publisher_class(self.context, has_lifecycle=True)
        publisher: Any = LifecycleNode.create_publisher(self, *args, **kwargs, publisher_class=make)
        self._managed_entities.add(publisher)
        self.surroundings.adopt(self, publisher)
        return publisher  # type: ignore[no-any-return]

    def create_timer(
        self, timer_period_sec: float, callback: Any, *args: Any, **kwargs: Any
    ) -> Timer:
        """Like rclpy's, but an exception in the callback starts error processing."""
        # rclpy's rates are timers without a callback.
        guarded = self.guarded(callback) if callable(callback) else callback
        create = super().create_timer
        timer: Timer = self.surroundings.create_timer(
            self, create, timer_period_sec, guarded, *args, **kwargs
        )
        return timer

    def create_rate(self, *args: Any, **kwargs: Any) -> Rate:
        """Like rclpy's."""
        rate: Rate = self.surroundings.create_rate(self, super().create_rate, *args, **kwargs)
        return rate

    def create_publisher(self, *args: Any, **kwargs: Any) -> Publisher:
        """Like rclpy's."""
        make = self.surroundings.publisher_class(self.context, has_lifecycle=False)
        if make is not None:
            kwargs.setdefault("publisher_class", make)
        publisher = super().create_publisher(*args, **kwargs)
        self.surroundings.adopt(self, publisher)
        return publisher

    def create_client(self, *args: Any, **kwargs: Any) -> Client:
        """Like rclpy's."""
        client = super().create_client(*args, **kwargs)
        self.surroundings.adopt(self, client)
        return client

    def create_guard_condition(self, callback: Any, *args: Any, **kwargs: Any) -> GuardCondition:
        """Like rclpy's, but an exception in the callback starts error processing."""
        guard = super().create_guard_condition(self.guarded(callback), *args, **kwargs)
        self.surroundings.adopt(self, guard)
        return guard

    def add_waitable(self, waitable: Any) -> None:
        """Like rclpy's."""
        super().add_waitable(waitable)
        self.surroundings.adopt(self, waitable)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., Any], *args: Any, **kwargs: Any
    ) -> Subscription:
        """Like rclpy's, but an exception in the callback starts error processing.

        If the process has a clock page, it replaces rclpy's subscription to `/clock`.
        """
        feed: Any = self.surroundings.clock_feed(self, callback)
        if feed is not None:
            return feed  # type: ignore[no-any-return]
        subscription = super().create_subscription(
            msg_type, topic, self.guarded(callback), *args, **kwargs
        )
        self.surroundings.adopt(self, subscription)
        return subscription

    def destroy_subscription(self, subscription: Any) -> bool:
        """Like rclpy's."""
        if isinstance(subscription, ClockFeed):
            subscription.close()
            return True
        self.surroundings.release(subscription)
        return bool(super().destroy_subscription(subscription))

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Callable[..., Any], *args: Any, **kwargs: Any
    ) -> Service:
        """Like rclpy's, but an exception in the callback starts error processing.

        So does a return value that is not a response of this type.
        """
        # rclpy also creates its parameter services through this method.
        checked = self._guarded_service(srv_type, callback)
        service = super().create_service(
            srv_type, srv_name, guard_service(checked, self.fail), *args, **kwargs
        )
        self.surroundings.adopt(self, service)
        return service

    def _guarded_service(self, srv_type: Any, callback: Callable[..., Any]) -> Callable[..., Any]:
        if srv_type in SETTING_SERVICES:
            return guard_setting_service(self, srv_type, callback)
        return self.live_parameters.around(callback)

    def destroy_service(self, service: Service) -> bool:
        """Like rclpy's."""
        self.surroundings.release(service)
        return bool(super().destroy_service(service))

    def add_on_set_parameters_callback(self, callback: Any) -> None:
        """Like rclpy's, but an exception in the callback rejects the parameters."""
        super().add_on_set_parameters_callback(GuardedCheck(callback))

    def remove_on_set_parameters_callback(self, callback: Any) -> None:
        """Like rclpy's."""
        super().remove_on_set_parameters_callback(GuardedCheck(callback))

    def on_parameters(self, changed: frozenset[str]) -> None:
        """Update values that depend on parameters, such as gains; override this method.

        The node calls it between two callbacks, while inactive or active. Compute the initial
        values in `on_configure`.

        Args:
            changed: names of the `Parameter`s that have a new value.
        """

    def set_parameters(self, parameter_list: list[Parameter]) -> list[SetParametersResult]:
        """Like rclpy's, but new values of `Parameter`s take effect together."""
        with self.live_parameters.held():
            return list(super().set_parameters(parameter_list))

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Like rclpy's, but new values of `Parameter`s take effect after the running callbacks."""
        with self.live_parameters.held():
            return super().set_parameters_atomically(parameter_list)

    def trigger_configure(self) -> TransitionCallbackReturn:
        """Configure now, on this thread."""
        return self._settled(super().trigger_configure)

    def trigger_cleanup(self) -> TransitionCallbackReturn:
        """Clean up now, on this thread."""
        return self._settled(super().trigger_cleanup)

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        """Shut down now, on this thread."""
        return self._settled(super().trigger_shutdown)

    def trigger_activate(self) -> TransitionCallbackReturn:
        """Activate now, on this thread."""
        return self._settled(super().trigger_activate)

    def trigger_deactivate(self) -> TransitionCallbackReturn:
        """Deactivate now, on this thread."""
        return self._settled(super().trigger_deactivate)

    def _settle(self, state: str) -> None:
        """Start or stop what belongs to the state after a transition; for subclasses.

        It is called after every transition, even if an override did not call the library's method.

        Args:
            state: `unconfigured`, `inactive`, `active` or `finalized`.
        """

    def _settled(self, trigger: Callable[[], TransitionCallbackReturn]) -> TransitionCallbackReturn:
        with self._transition_lock, self.live_parameters.held():
            self._forget_fault_at_rest()
            result = trigger()
            state = self.state_label
            try:
                self._settle(state)
            except Exception as error:
                self._keep_fault(error, f"settling in `{state}`")
                self._is_unrecoverable = True
            self._forget_fault_at_rest()
            self._end_if_unrecoverable()
        if self.executor is None:
            self._enter_error_processing()
        return result

    def _end_if_unrecoverable(self) -> None:
        if self._is_unrecoverable and not self.ended.done():
            self.ended.set_result(self.last_fault)

    def _enter_error_processing(self) -> None:
        # The state machine has no transition from a primary state to error processing. So this
        # starts a transition whose callback immediately returns ERROR (see _guarded_transition).
        triggers = {"active": self.trigger_deactivate, "inactive": self.trigger_cleanup}
        with self._transition_lock:
            if not self._is_failing:
                return
            if self.state_label in triggers:
                triggers[self.state_label]()
            else:
                self._forget_fault_at_rest()

    def _forget_fault_at_rest(self) -> None:
        """Clear a fault in a state in which no callbacks run; no error processing follows."""
        if self.state_label in ("unconfigured", "finalized"):
            self._is_failing = False

    def _keep_fault(self, cause: BaseException | str, where: str) -> None:
        self.last_fault = fault_of(cause, where)
        # Indented, so that related lines stay recognizable in the output of several nodes.
        self.get_logger().error(str(self.last_fault).replace("\n", "\n  "))

    def _guarded_transition(self, callback: TransitionCallback) -> TransitionCallback:
        where, method = callback.__name__, callback.__qualname__
        failed = TransitionCallbackReturn.FAILURE if where == "on_error" else ERROR

        def call(state: LifecycleState) -> TransitionCallbackReturn:
            if where == "on_error":
                result = attempt(state)
                self._is_unrecoverable = result != SUCCESS
                return result
            if self.is_failing():
                return ERROR
            if where == "on_configure":
                self.last_fault = None
                self.live_parameters.configure()
            result = attempt(state)
            return ERROR if self.is_failing() else result

        def attempt(state: LifecycleState) -> TransitionCallbackReturn:
            try:
                result = callback(state)
            except (Exception, SystemExit) as error:  # an exit would leave it between two states
                self._keep_fault(error, where)
                return failed
            if not isinstance(result, TransitionCallbackReturn):
                self._keep_fault(wrong_answer(method, result, "TransitionCallbackReturn"), where)
                return failed
            # If the callback called `fail`, the reason is already reported.
            if result != SUCCESS and not self.is_failing():
                self._keep_fault(
                    f"`{method}` returned {result.name} without a reason; "
                    "raise an exception with the reason instead",
                    where,
                )
            return result

        return call

    def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        requested = request.transition
        with self._transition_lock:
            # Otherwise the requested transition would fail for a fault that is not its own, and a
            # launcher would take that for a rejection.
            self._enter_error_processing()
            allowed = {
                edge[0]: edge[1]
                for edge in self._state_machine.available_transitions
                if edge[0] in self._triggers
            }
            by_label = {label: number for number, label in allowed.items()}
            number = (
                by_label.get(requested.label, NO_TRANSITION)
                if requested.label
                else int(requested.id)
            )
            if number in allowed:
                response.success = self._triggers[number]() == SUCCESS
                return response
        self.get_logger().warning(
            f"rejected the transition `{requested.label or requested.id}` in the state "
            f"`{self.state_label}`; allowed: {', '.join(by_label) or 'none'}"
        )
        response.success = False
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
