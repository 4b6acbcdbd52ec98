"""Set parameters of running nodes and report the result; list tunable parameters.

Used by `obk param`, `obk monitor` and `obk web`.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from obelisk_spec.suggestions import did_you_mean
from obk_cli.emit.params import emit_value
from obk_cli.errors import CommandFailedError
from obk_cli.ros.parameters import (
    NOT_SET,
    UNDESCRIBED,
    NodeParameter,
    ParameterDescription,
    SetAnswer,
    fit_parameter,
    parse_parameter,
    refusal,
)
from obk_cli.terminal import escaped, plain

if TYPE_CHECKING:
    from obk_cli.introspect.graph_source import Parameters

__all__ = ["ChangedParameter", "TunableParameter", "set_parameter", "tunable", "value_text"]

EFFECT_S: Final = 1.0
"""Limit for a change to take effect while callbacks of the node are running [s]."""
ASK_AGAIN_S: Final = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class TunableParameter:
    """A parameter that a node declares with `Parameter`, and its value."""

    name: str
    value: NodeParameter
    description: ParameterDescription


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangedParameter:
    """The result of setting a parameter, after the node accepted it."""

    name: str
    before: NodeParameter
    after: NodeParameter
    unit: str
    effect: str
    """When the value takes effect, as the node reports it; empty if it does not."""

    def __str__(self) -> str:
        """One sentence: "kp changed from 20.0 to 25.0 N m/rad, in effect"."""
        new = value_text(self.after) + (f" {self.unit}" if self.unit else "")
        if not self.effect:
            new += f" ({self.after.kind})"
        change = f"changed from {value_text(self.before)} to {new}"
        if self.before == self.after:
            change = f"is already {new}"
        effect = f", {escaped(self.effect)}" if self.effect else ""
        return f"{self.name} {change}{effect}"


def value_text(parameter: NodeParameter) -> str:
    """A value as a person would write it."""
    return NOT_SET if parameter.value is None else plain(emit_value(parameter.value))


def tunable(parameters: "Parameters") -> tuple[TunableParameter, ...]:
    """The parameters that a node declares with `Parameter`, in its order.

    Raises:
        CommandFailedError: the node does not answer.
    """
    described: Mapping[str, ParameterDescription] = {
        name: one
        for name, one in parameters.describe(parameters.names()).items()
        if one.notes.is_live is not None
    }
    values = parameters.values(tuple(described)) if described else {}
    return tuple(
        TunableParameter(name=name, value=values[name], description=one)
        for name, one in described.items()
    )


def set_parameter(parameters: "Parameters", node: str, name: str, text: str) -> ChangedParameter:
    """Set a parameter, and wait briefly for it to take effect.

    Args:
        parameters: the parameters of the node.
        node: full name.
        name: name of the parameter.
        text: the value, as in a ROS parameter file.

    Raises:
        MisuseError: the text is not a valid parameter value.
        CommandFailedError: the node rejects the value, fails because of it, or does not answer.
    """
    given = parse_parameter(text)
    before = parameters.values((name,))[name]
    description = parameters.describe((name,)).get(name, UNDESCRIBED)
    kind = description.kind if before.kind == NOT_SET else before.kind
    after = fit_parameter(text, given, kind)
    answer = _set(parameters, name, after)
    if not answer.successful:
        _require_known(node, name, parameters)
        why = escaped(refusal(answer.reason, after))
        raise CommandFailedError(
            f"{node} rejected {name} = {value_text(after)}: {why}",
            help=f"its type is {kind}, its value: {value_text(before)}"
            if kind not in (after.kind, NOT_SET)
            else None,
        )
    if answer.has_failed:
        raise CommandFailedError(
            f"{node}: {name} = {value_text(after)} is {escaped(answer.reason)}",
            help=f"its value before: {value_text(before)}",
        )
    return ChangedParameter(
        name=name,
        before=before,
        after=after,
        unit=description.notes.unit,
        effect=answer.reason,
    )


def _set(parameters: "Parameters", name: str, value: NodeParameter) -> SetAnswer:
    """Set a parameter; if the node is busy, set it again to find out whether it took effect."""
    answer = parameters.set(name, value)
    end_s = time.monotonic() + EFFECT_S
    while answer.is_waiting and time.monotonic() < end_s:
        time.sleep(ASK_AGAIN_S)
        answer = parameters.set(name, value)
    return answer


def _require_known(node: str, name: str, parameters: "Parameters") -> None:
    known = parameters.names()
    if name not in known:
        raise CommandFailedError(
            f"{node} has no parameter `{name}`", help=did_you_mean(name, known)
        )
