"""Check new values of a node's parameters, by rules and by the node's state.

Any node may call the `~/set_parameters` services. Either the parameters are set, or the response
contains the reason. No request can stop the node. Parameters that are set together are accepted or
rejected together. The node's own code may set invalid settings before the `configure` transition,
which then raises an exception.
"""

from collections.abc import Callable, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, Final

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from obelisk_py.core.exceptions import ObeliskError
from obelisk_py.core.faults import wrong_answer
from obelisk_spec.suggestions import did_you_mean

__all__ = [
    "SETTING_SERVICES",
    "Getter",
    "GuardedCheck",
    "ParameterRules",
    "guard_setting_service",
]

Getter = Callable[[str], Any]
"""Returns the current or requested value of a parameter."""
SETTING_SERVICES: Final = (SetParameters, SetParametersAtomically)
READ_AT_CONFIGURE: Final = (
    "is read during the `configure` transition: clean up, set it, configure again"
)
_FREE_STATES: Final = ("unconfigured", "configuring", "finalized")
"""States in which nothing depends on parameters that `configure` reads."""
_is_requested: ContextVar[bool] = ContextVar("is_requested", default=False)
"""Whether a service sets the parameters, as opposed to the node's own code."""


@dataclass(frozen=True, slots=True)
class GuardedCheck:
    """A callback that checks parameters; an exception or an invalid return value rejects them.

    Two instances with the same callback are equal, so that rclpy can find and remove them.
    """

    callback: Callable[[list[Parameter]], SetParametersResult]

    def __call__(self, parameters: list[Parameter]) -> SetParametersResult:
        """Check whether the parameters may be set."""
        names = ", ".join(f"`{parameter.name}`" for parameter in parameters)
        try:
            result = self.callback(parameters)
        except Exception as error:
            return _rejection(f"the node's check of {names} raised {type(error).__name__}: {error}")
        if isinstance(result, SetParametersResult):
            return result
        method = getattr(self.callback, "__qualname__", repr(self.callback))
        reason = wrong_answer(method, result, SetParametersResult.__name__)
        return _rejection(f"the node's check of {names}: {reason}")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rule:
    """A check of parameters that belong together."""

    names: tuple[str, ...]
    check: Callable[[Getter], object] | None
    is_read_at_configure: bool


class ParameterRules:
    """The rules for the parameters that the library reads from a node."""

    def __init__(self, node: Node, state: Callable[[], str]) -> None:
        """Check all future requests to set parameters.

        Args:
            node: the node with the parameters.
            state: returns the label of its lifecycle state.
        """
        self._node = node
        self._state = state
        self._rules: list[_Rule] = []
        node.add_on_set_parameters_callback(self._decide)

    def add(
        self,
        names: Sequence[str],
        check: Callable[[Getter], object] | None = None,
        *,
        is_read_at_configure: bool = True,
    ) -> None:
        """Add a rule.

        Args:
            names: the parameters that the rule checks.
            check: takes a function that returns their values; raises `ObeliskError` if they are
                invalid. None accepts every value.
            is_read_at_configure: whether to reject a different value while the node is configured.
        """
        rule = _Rule(names=tuple(names), check=check, is_read_at_configure=is_read_at_configure)
        self._rules.append(rule)

    def _decide(self, parameters: list[Parameter]) -> SetParametersResult:
        # Parameters under declaration are checked in `configure`, together with all others.
        new = {p.name: p.value for p in parameters if self._node.has_parameter(p.name)}

        def value(name: str) -> Any:
            return new[name] if name in new else self._node.get_parameter(name).value

        for rule in self._rules:
            own_names = [name for name in rule.names if name in new]
            if not own_names:
                continue
            # Values set by the node's own code, such as a test, make `configure` fail.
            is_checked = _is_requested.get() or not self._is_read_later(rule)
            try:
                if rule.check is not None and is_checked:
                    rule.check(value)
            except ObeliskError as error:
                return _rejection(str(error))
            for name in own_names:
                if rule.is_read_at_configure and self._would_be_half_applied(name, new[name]):
                    return _rejection(f"`{name}` {READ_AT_CONFIGURE}")
        return SetParametersResult(successful=True)

    def _is_read_later(self, rule: _Rule) -> bool:
        return rule.is_read_at_configure and self._state() in _FREE_STATES

    def _would_be_half_applied(self, name: str, value: object) -> bool:
        # A parameter that is declared with only a type may have no value yet.
        present = self._node.get_parameter_or(name).value
        return self._state() not in _FREE_STATES and value != present


def guard_setting_service(
    node: Any, srv_type: type[Any], callback: Callable[[Any, Any], Any]
) -> Callable[[Any, Any], Any]:
    """Wrap the callback of one of `SETTING_SERVICES`.

    Requests for parameters that cannot be set do not reach rclpy, which raises an exception for an
    unknown parameter type and accepts a parameter without a name. If a `Parameter` is set, the
    response's reason says when the new value takes effect.
    """

    def requested(request: Any, response: Any) -> Any:
        token = _is_requested.set(True)
        try:
            return callback(request, response)
        finally:
            _is_requested.reset(token)

    def set_each(request: Any, response: Any) -> Any:
        messages = list(map(node.live_parameters.fitted, request.parameters))
        with node.live_parameters.held():
            for message in messages:
                reason = _rejection_reason(node, message)
                if reason is None:
                    requested(SetParameters.Request(parameters=[message]), response)
                else:
                    response.results.append(_rejection(reason))
        for message, result in zip(messages, response.results, strict=True):
            if result.successful:
                result.reason = node.live_parameters.effect(message.name)
        return response

    def set_together(request: Any, response: Any) -> Any:
        messages = list(map(node.live_parameters.fitted, request.parameters))
        reasons = [_rejection_reason(node, message) for message in messages]
        rejected = [reason for reason in reasons if reason is not None]
        if rejected:
            response.result = _rejection("; ".join(rejected))
            return response
        with node.live_parameters.held():
            requested(SetParametersAtomically.Request(parameters=messages), response)
        if response.result.successful:
            effects = dict.fromkeys(node.live_parameters.effect(m.name) for m in messages)
            response.result.reason = "; ".join(filter(None, effects))
        return response

    return set_each if srv_type is SetParameters else set_together


def _rejection_reason(node: Any, message: Any) -> str | None:
    """Why a parameter cannot be set, apart from the node's own checks; None if it can."""
    known = {kind.value: kind.name.lower() for kind in Parameter.Type}
    if message.value.type not in known:
        kinds = ", ".join(f"{number} ({kind})" for number, kind in known.items())
        given = message.value.type
        return f"`{message.name}` has a value of the type {given}; expected one of: {kinds}"
    if not message.name or not (
        node.has_parameter(message.name) or node._allow_undeclared_parameters
    ):
        hint = did_you_mean(message.name, sorted(node._parameters))
        return f"the node has no parameter `{message.name}`; {hint}"
    fault: str | None = node.live_parameters.fault(Parameter.from_parameter_msg(message))
    return fault


def _rejection(reason: str) -> SetParametersResult:
    return SetParametersResult(successful=False, reason=reason)
