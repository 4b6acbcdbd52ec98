"""`set_parameter` without ROS: what it makes of a node's answer."""

from collections.abc import Sequence
from typing import Any

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.introspect.tuning import set_parameter
from obk_cli.ros.parameters import NodeParameter, ParameterDescription, SetAnswer


class Answering:
    """Parameters of a node that gives one answer to each request."""

    def __init__(self, answer: SetAnswer) -> None:
        self.answer = answer

    def names(self) -> tuple[str, ...]:
        return ("kp",)

    def values(self, names: Sequence[str]) -> dict[str, NodeParameter]:
        return {name: NodeParameter(kind="double", value=1.0) for name in names}

    def describe(self, _: Sequence[str]) -> dict[str, ParameterDescription]:
        return {}

    def set(self, _name: str, _value: NodeParameter) -> SetAnswer:
        return self.answer


def changed(*, successful: bool, reason: str) -> str:
    parameters: Any = Answering(SetAnswer(successful=successful, reason=reason))
    return str(set_parameter(parameters, "/arm", "kp", "2.0"))


def test_a_change_is_reported_with_its_effect() -> None:
    assert changed(successful=True, reason="in effect").endswith("in effect")


@pytest.mark.parametrize(
    ("successful", "reason"),
    [(False, "too large"), (True, "set, but `on_parameters` failed: ValueError: no gain")],
)
def test_a_rejection_and_a_failure_are_errors(successful: bool, reason: str) -> None:
    with pytest.raises(CommandFailedError) as caught:
        changed(successful=successful, reason=reason)
    assert "kp" in caught.value.message
    assert reason in caught.value.message
