"""Apply new values of a node's `Parameter`s between two callbacks.

Each callback records that it is running, and a change waits until none is running. Then all waiting
values are set together, and `on_parameters` is called before the next callback. On an executor with
several threads, there may never be a moment without a running callback. A callback that starts
while a change is waiting therefore waits too, but for no longer than its own last measured run
took. Thus a slow callback never blocks a fast loop for long. Runs are measured only while a change
is waiting.
"""

import functools
import inspect
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from rclpy.parameter import Parameter as RosParameter

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.parameter import Parameter, parameters_of

__all__ = ["IN_EFFECT", "LiveParameters"]

IN_EFFECT: Final = "in effect"
STORED: Final = "stored; takes effect at the next `configure` transition"
WAITS: Final = "accepted; takes effect when no callback of the node is running"
FAILED: Final = "set, but `on_parameters` failed"
"""The `reason` in the reply when a value is accepted; tools show it verbatim."""
_REPORT: Final = "on_parameters"
"""Where a node fails that cannot use its new values."""
_CONFIGURED: Final = ("inactive", "active")


class LiveParameters:
    """The values of a node's parameters and the callbacks that use them."""

    def __init__(self, node: Any) -> None:
        """Collect the parameters of the node's class; `declare` sets the initial values.

        Args:
            node: a `GuardedLifecycleNode`; rclpy's constructor may not have run yet.
        """
        self._node = node
        self._declared: dict[str, Parameter[Any]] = parameters_of(type(node))
        self._running: dict[object, float] = {}
        """The running callbacks and, if measured, their start times [s]. The key is the thread's
        identifier or, for a coroutine, a new object, because other callbacks can run on the thread
        while the coroutine is suspended."""
        self._changing = threading.Condition(threading.RLock())
        # Read without the lock: a callback first records that it is running and then reads this
        # flag. A change first sets the flag and then checks for running callbacks.
        self._is_waiting = False
        self._is_applying = False
        self._waiting: dict[str, Any] = {}
        self._for_configure: dict[str, Any] = {}

    def declare(self) -> None:
        """Declare the ROS parameters and set the attributes to the values from the config.

        Raises:
            ObeliskConfigError: a value in the config has the wrong type or is out of range.
        """
        node = self._node
        for name, parameter in self._declared.items():
            first = default = parameter.to_ros()
            given = node._parameter_overrides.get(name)
            if given is not None:
                first = node._parameter_overrides[name] = parameter.fit(given)
                fault = parameter.fault(first)
                if fault is not None:
                    raise ObeliskConfigError(fault)
            declared = node.declare_parameter(name, default.value, parameter.descriptor(first))
            vars(node)[name] = parameter.value(declared)
        if self._declared:
            node.add_post_set_parameters_callback(self._note)

    def fitted(self, message: Any) -> Any:
        """Convert a requested value to the parameter's type: an integer is valid for a float."""
        parameter = self._declared.get(message.name)
        if parameter is None:
            return message
        return parameter.fit(RosParameter.from_parameter_msg(message)).to_parameter_msg()

    def fault(self, requested: RosParameter) -> str | None:
        """Why a requested value is invalid.

        Returns:
            None if it is valid, or if the parameter was not declared with `Parameter`.
        """
        parameter = self._declared.get(requested.name)
        return None if parameter is None else parameter.fault(requested)

    def effect(self, name: str) -> str:
        """When the latest value takes effect; empty for a parameter that is not declared here."""
        if name not in self._declared:
            return ""
        with self._changing:
            if name in self._for_configure:
                return STORED
            if name in self._waiting:
                return WAITS
        fault = self._node.last_fault
        if self._node.is_failing() and fault is not None and fault.where == _REPORT:
            return f"{FAILED}: {fault.text}"
        return IN_EFFECT

    def configure(self) -> None:
        """Apply the values stored for this `configure` transition."""
        with self._changing:
            vars(self._node).update(self._for_configure)
            self._for_configure.clear()

    def around(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a callback so that values change only before or after it."""
        if not self._declared:
            return callback
        running, thread_id = self._running, threading.get_ident
        took_s = [0.0]

        @functools.wraps(callback)
        async def wait(*args: Any) -> Any:
            key = object()
            running[key] = 0.0
            if self._is_waiting:
                self._give_way(key, took_s[0])
            try:
                return await callback(*args)
            finally:
                since_s = running.pop(key)
                if self._is_waiting:
                    self._end(since_s, took_s)

        @functools.wraps(callback)
        def call(*args: Any) -> Any:
            key = thread_id()
            if key in running:  # nested in another callback
                return callback(*args)
            running[key] = 0.0
            if self._is_waiting:
                self._give_way(key, took_s[0])
            try:
                return callback(*args)
            finally:
                since_s = running.pop(key)
                if self._is_waiting:
                    self._end(since_s, took_s)

        return wait if inspect.iscoroutinefunction(callback) else call

    @contextmanager
    def held(self) -> Iterator[None]:
        """Postpone changes until the end of the `with` block, then apply them together."""
        key = threading.get_ident()
        if not self._declared or key in self._running:
            yield
            return
        self._running[key] = 0.0
        if self._is_waiting:
            self._give_way(key, 0.0)
        try:
            yield
        finally:
            since_s = self._running.pop(key)
            if self._is_waiting:
                self._end(since_s, [0.0])

    def _note(self, parameters: Iterable[RosParameter]) -> None:
        """Record values that rclpy has accepted."""
        with self._changing:
            for given in parameters:
                parameter = self._declared.get(given.name)
                if parameter is None:
                    continue
                value = parameter.value(given)
                if parameter.notes.is_live:
                    self._waiting[given.name] = value
                    self._is_waiting = True
                elif value != vars(self._node)[given.name]:
                    self._for_configure[given.name] = value
                else:
                    self._for_configure.pop(given.name, None)

    def _give_way(self, key: object, longest_s: float) -> None:
        """Apply a waiting change before a callback, which has already been recorded as running.

        Args:
            key: the callback's key in `_running`.
            longest_s: maximum time to wait for other callbacks [s].
        """
        with self._changing:
            del self._running[key]
            end_s = time.monotonic() + longest_s
            self._apply()
            # A suspended coroutine may need this thread to continue, so never wait for one.
            # A copy, because other threads add and remove callbacks without the lock.
            while any(isinstance(other, int) for other in tuple(self._running)):
                left_s = end_s - time.monotonic()
                if not self._is_waiting or left_s <= 0:
                    break
                self._changing.wait(left_s)
                self._apply()
            self._running[key] = time.monotonic()

    def _end(self, since_s: float, took_s: list[float]) -> None:
        """Apply a waiting change after a callback, and record how long the callback took."""
        if since_s:
            took_s[0] = time.monotonic() - since_s
        with self._changing:
            self._apply()
            self._changing.notify_all()

    def _apply(self) -> None:
        """Apply waiting values unless a callback is running; the caller holds the lock."""
        if self._running or self._is_applying:
            return
        self._is_applying = True
        try:
            while self._waiting:
                values, self._waiting = self._waiting, {}
                present = vars(self._node)
                changed = {n: value for n, value in values.items() if value != present[n]}
                present.update(changed)
                if changed:
                    self._report(frozenset(changed))
        finally:
            self._is_waiting = bool(self._waiting)
            self._is_applying = False
            self._changing.notify_all()

    def _report(self, changed: frozenset[str]) -> None:
        node = self._node
        if node.state_label not in _CONFIGURED or node.is_failing():
            return
        try:
            node.on_parameters(changed)
        except Exception as error:
            node.fail(error, _REPORT)
