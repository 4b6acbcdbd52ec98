from collections.abc import Mapping, Sequence

import pytest

from obelisk_spec.registration import (
    ArgumentKind,
    RegistrationArgumentError,
    bind_registration,
    is_expected,
    is_required_by_default,
)


class Message:
    """A fake message class."""


def callback() -> None:
    """A fake callback."""


def described(value: object) -> str | ArgumentKind:
    if isinstance(value, str):
        return value
    if value is None:
        return ArgumentKind.NOTHING
    if isinstance(value, type):
        return ArgumentKind.CLASS
    if isinstance(value, dict):
        return ArgumentKind.MAPPING
    return ArgumentKind.FUNCTION if callable(value) else ArgumentKind.UNKNOWN


def bind(
    method: str, positional: Sequence[object], named: Mapping[str, object] | None = None
) -> dict[str, object]:
    bound = bind_registration(f"register_obk_{method}", positional, named or {}, described)
    return {key: value for key, value in bound.items() if value is not None}


G1 = [
    ("publisher", ("x_setting",), {}, {"ros_parameter": "x_setting"}),
    ("publisher", ("p", "x"), {}, {"ros_parameter": "p", "key": "x"}),
    ("publisher", ("p", "x", Message), {}, {"ros_parameter": "p", "key": "x", "msg_type": Message}),
    ("publisher", ("p", None, Message), {}, {"ros_parameter": "p", "msg_type": Message}),
    ("publisher", ("p", "x", None, {"topic": "/x"}), {}, {"ros_parameter": "p", "key": "x"}),
    ("publisher", ("p",), {"key": "x", "msg_type": Message}, {"ros_parameter": "p", "key": "x"}),
    ("publisher", (), {"ros_parameter": "p"}, {"ros_parameter": "p"}),
    ("subscription", ("p", callback, "x", Message), {}, {"ros_parameter": "p", "key": "x"}),
    ("subscription", ("p", callback), {"key": "x"}, {"ros_parameter": "p", "key": "x"}),
    ("timer", ("p", callback, "x"), {}, {"ros_parameter": "p", "key": "x"}),
    ("timer", ("p", callback), {"key": "x"}, {"ros_parameter": "p", "key": "x"}),
]
G2 = [
    ("publisher", ("x_setting", Message), {}, {"ros_parameter": "x_setting", "msg_type": Message}),
    ("publisher", ("p", Message, "x"), {}, {"ros_parameter": "p", "key": "x", "msg_type": Message}),
    ("publisher", ("p", None, "x"), {}, {"ros_parameter": "p", "key": "x"}),
    ("publisher", ("p", Message, "x", "topic:/x"), {}, {"key": "x", "default": "topic:/x"}),
    (
        "publisher",
        ("p", Message),
        {"key": "x", "default_config_str": "topic:/x"},
        {"ros_parameter": "p", "key": "x", "default": "topic:/x"},
    ),
    ("subscription", ("p", callback, Message, "x"), {}, {"ros_parameter": "p", "key": "x"}),
    (
        "subscription",
        (),
        {"ros_parameter": "p", "callback": callback, "msg_type": Message, "key": "x"},
        {"ros_parameter": "p", "key": "x", "callback": callback},
    ),
    ("timer", ("p", callback, "x", "timer_period_sec:1"), {}, {"key": "x", "ros_parameter": "p"}),
]
G3 = [
    ("publisher", ("x", Message), {}, {"key": "x", "msg_type": Message}),
    ("publisher", ("x",), {"msg_type": Message}, {"key": "x", "msg_type": Message}),
    ("publisher", (), {"key": "x", "msg_type": Message}, {"key": "x", "msg_type": Message}),
    ("subscription", ("x", callback, Message), {}, {"key": "x", "msg_type": Message}),
    ("subscription", ("x", callback), {"msg_type": Message}, {"key": "x", "callback": callback}),
    ("timer", ("x", callback), {}, {"key": "x", "callback": callback}),
    ("timer", (), {"key": "x", "callback": callback}, {"key": "x", "callback": callback}),
]


@pytest.mark.parametrize(("method", "positional", "named", "expected"), [*G1, *G2, *G3])
def test_every_generation_binds_the_same_arguments(
    method: str,
    positional: tuple[object, ...],
    named: dict[str, object],
    expected: dict[str, object],
) -> None:
    assert expected.items() <= bind(method, positional, named).items()


@pytest.mark.parametrize(("method", "positional", "named"), [row[:3] for row in G3])
def test_a_call_with_only_a_key_is_of_the_third_generation(
    method: str, positional: tuple[object, ...], named: dict[str, object]
) -> None:
    bound = bind(method, positional, named)
    assert "ros_parameter" not in bound
    assert not is_required_by_default(None)


def test_a_call_that_names_a_ros_parameter_is_of_an_older_generation() -> None:
    assert is_required_by_default("x_setting")


def test_an_unknown_expression_before_a_key_is_the_message_type() -> None:
    unknown = object()
    assert bind("publisher", ("p", unknown, "x"))["msg_type"] is unknown
    assert bind("publisher", ("x", unknown))["msg_type"] is unknown
    assert bind("publisher", ("p", unknown, Message))["key"] is unknown


@pytest.mark.parametrize(
    ("positional", "named", "words"),
    [
        (("p", callback, "x", "topic:/x", None), {}, ("5 positional", "at most 4")),
        (("p", callback), {"callback": callback}, ("`callback`", "twice")),
        (("p", callback, "x"), {"ros_parameter": "q"}, ("`ros_parameter`", "twice")),
        (("p", callback), {"default": "a", "default_config_str": "b"}, ("`default`", "twice")),
        (("p", callback), {"defualt": "a"}, ("`defualt`", "`default`")),
        (("p", callback), {"msg_type": Message}, ("`msg_type`",)),
    ],
)
def test_arguments_of_no_generation_are_an_error(
    positional: tuple[object, ...], named: dict[str, object], words: tuple[str, ...]
) -> None:
    with pytest.raises(RegistrationArgumentError) as caught:
        bind("timer", positional, named)
    assert all(word in str(caught.value) for word in words)


@pytest.mark.parametrize(
    ("argument", "described_as", "is_right"),
    [
        ("key", "x", True),
        ("key", ArgumentKind.CLASS, False),
        ("msg_type", "PositionSetpoint", False),
        ("msg_type", ArgumentKind.CLASS, True),
        ("callback", ArgumentKind.FUNCTION, True),
        ("callback", ArgumentKind.CLASS, False),
        ("default", ArgumentKind.MAPPING, True),
        ("default", "topic:/x", True),
        ("required", ArgumentKind.TRUTH_VALUE, True),
        ("required", "yes", False),
        ("key", ArgumentKind.NOTHING, True),
        ("key", ArgumentKind.UNKNOWN, True),
    ],
)
def test_each_argument_has_its_types(
    argument: str, described_as: str | ArgumentKind, is_right: bool
) -> None:
    assert is_expected(argument, described_as) is is_right
