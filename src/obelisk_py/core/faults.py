"""Represent failures of a node as values, and wrap callbacks so that they report them."""

import functools
import inspect
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from obelisk_py.core.exceptions import ObeliskError
from obelisk_spec.suggestions import with_article

__all__ = ["NodeFault", "fault_of", "guard_callback", "guard_service", "wrong_answer"]

Callback = Callable[..., Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeFault:
    """A failure in a node."""

    where: str
    """Name of the failed callback in the code."""
    text: str
    """One sentence, or one per finding."""
    traceback: str
    """The Python traceback; empty if the code is not the cause."""

    def __str__(self) -> str:
        return f"{self.where}: {self.text}" + (f"\n{self.traceback}" if self.traceback else "")


def fault_of(cause: BaseException | str, where: str) -> NodeFault:
    """Build a fault from an exception or a message."""
    if isinstance(cause, str):
        return NodeFault(where=where, text=cause, traceback="")
    if isinstance(cause, ObeliskError):
        # The message names the mistake; the location that detected it does not help.
        return NodeFault(where=where, text=str(cause), traceback="")
    return NodeFault(
        where=where,
        text=f"{type(cause).__name__}: {cause}",
        traceback="".join(traceback.format_exception(cause)).rstrip(),
    )


def wrong_answer(method: str, answer: object, expected: str) -> str:
    """Return the message for an unexpected return value of a callback."""
    hint = " (did the callback forget its return statement?)" if answer is None else ""
    return f"`{method}` returned {answer!r}, expected {with_article(expected)}{hint}"


def guard_callback(
    callback: Callback, is_failing: Callable[[], bool], fail: Callable[[Exception, str], None]
) -> Callback:
    """Wrap a callback: pass exceptions to `fail`, and skip the call while the node is failing."""
    where = getattr(callback, "__qualname__", repr(callback))

    @functools.wraps(callback)
    async def wait(*args: Any) -> Any:
        if is_failing():
            return None
        try:
            return await callback(*args)
        except Exception as error:
            fail(error, where)

    @functools.wraps(callback)
    def call(*args: Any) -> Any:
        if is_failing():
            return None
        try:
            return callback(*args)
        except Exception as error:
            fail(error, where)

    return wait if inspect.iscoroutinefunction(callback) else call


def guard_service(callback: Callback, fail: Callable[[Exception | str, str], None]) -> Callback:
    """Wrap a service callback: pass exceptions and invalid responses to `fail`.

    In either case, the client receives the response as the callback left it.
    """
    where = getattr(callback, "__qualname__", repr(callback))

    def checked(answer: Any, response: Any) -> Any:
        if isinstance(answer, type(response)):
            return answer
        fail(wrong_answer(where, answer, type(response).__name__), where)
        return response

    @functools.wraps(callback)
    async def wait(request: Any, response: Any) -> Any:
        try:
            return checked(await callback(request, response), response)
        except Exception as error:
            fail(error, where)
            return response

    @functools.wraps(callback)
    def call(request: Any, response: Any) -> Any:
        try:
            return checked(callback(request, response), response)
        except Exception as error:
            fail(error, where)
            return response

    return wait if inspect.iscoroutinefunction(callback) else call
