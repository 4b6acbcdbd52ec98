"""Registrations in the three generations of the Python API, and errors in them."""

from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from obelisk_control_msgs.msg import PositionSetpoint

from obelisk_py.core.components import ComponentKind, RegisteredComponent, registered_component
from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.obelisk_typing import ObeliskControlMsg

PUBLISHER, SUBSCRIPTION, TIMER = ComponentKind


def callback(message: object = None) -> None:
    del message


def register(
    kind: ComponentKind, positional: Sequence[Any], named: Mapping[str, Any]
) -> RegisteredComponent:
    return registered_component("arm", kind, positional, named)


@pytest.mark.parametrize(
    ("positional", "named"),
    [
        (("pub_x_setting", "pub_x", PositionSetpoint), {}),
        (("pub_x_setting",), {"key": "pub_x", "msg_type": PositionSetpoint}),
        (("pub_x_setting", PositionSetpoint, "pub_x"), {}),
        (("pub_x_setting", PositionSetpoint), {"key": "pub_x"}),
    ],
)
def test_older_publishers_have_a_ros_parameter(
    positional: Sequence[Any], named: Mapping[str, Any]
) -> None:
    component = register(PUBLISHER, positional, named)
    assert component.ros_parameter == "pub_x_setting"
    assert (component.key, component.msg_type) == ("pub_x", PositionSetpoint)


@pytest.mark.parametrize(
    ("kind", "positional", "named"),
    [
        (PUBLISHER, ("x", PositionSetpoint), {}),
        (PUBLISHER, (), {"key": "x", "msg_type": PositionSetpoint}),
        (SUBSCRIPTION, ("x", callback, PositionSetpoint), {}),
        (TIMER, ("x", callback), {}),
    ],
)
def test_components_of_the_third_generation_have_only_a_key(
    kind: ComponentKind, positional: Sequence[Any], named: Mapping[str, Any]
) -> None:
    component = register(kind, positional, named)
    assert (component.ros_parameter, component.key) == (None, "x")


def test_a_default_has_two_names() -> None:
    for name in ("default", "default_config_str"):
        component = register(PUBLISHER, ("p", PositionSetpoint, "x"), {name: "topic:/x"})
        assert component.default == "topic:/x"
    assert register(TIMER, ("p", callback, "x", "timer_period_sec:1"), {}).default is not None


@pytest.mark.parametrize(
    ("kind", "positional", "named", "sentence"),
    [
        (
            PUBLISHER,
            ("x", PositionSetpoint()),
            {},
            r"`key` is obelisk.* \(a `PositionSetpoint`\), expected a str",
        ),
        (PUBLISHER, ("x", int), {}, "`msg_type` is the class `int`, expected a message class"),
        (
            PUBLISHER,
            ("x", ObeliskControlMsg),
            {},
            r"`msg_type` is ~ObeliskControlMsg \(a `TypeVar`\), expected a message class",
        ),
        (PUBLISHER, ("x",), {"msg_type": "PositionSetpoint"}, r"'PositionSetpoint' \(a `str`\)"),
        (SUBSCRIPTION, ("x", PositionSetpoint, callback), {}, "`callback` is the class `Posit"),
        (SUBSCRIPTION, ("x", callback, 3), {}, r"`key` is 3 \(an `int`\), expected a str"),
        (TIMER, ("x", None), {}, "`x` has no `callback`, expected a function or method"),
        (TIMER, ("x", callback), {"default": 3}, "expected settings as a str or a dict"),
        (TIMER, ("x", callback), {"required": "no"}, "`required` is 'no'.*expected True or False"),
        (TIMER, (3, callback), {}, r"`key` is 3 \(an `int`\), expected a str"),
        (TIMER, (callback,), {}, r"`key` is the function `callback`, expected a str"),
        (TIMER, (), {"callback": callback}, "neither `key` nor `ros_parameter` is given"),
        (TIMER, ("x",), {"calback": callback}, "unexpected argument `calback`.*`callback`"),
    ],
)
def test_an_invalid_argument_is_named_with_the_expected_one(
    kind: ComponentKind, positional: Sequence[Any], named: Mapping[str, Any], sentence: str
) -> None:
    with pytest.raises(ObeliskConfigError, match=sentence) as caught:
        register(kind, positional, named)
    assert str(caught.value).startswith(f"register_obk_{kind.noun} of the node `arm`: ")


def test_existing_code_catches_a_value_error() -> None:
    with pytest.raises(ValueError, match="no `callback`"):
        register(TIMER, ("x",), {})
