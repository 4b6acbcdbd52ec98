"""Parameter values, as typed by a user."""

import pytest

from obk_cli.errors import MisuseError
from obk_cli.ros.parameters import KINDS, NodeParameter, fit_parameter, parse_parameter, refusal


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("true", "bool", True),
        ("5", "integer", 5),
        ("-5", "integer", -5),
        ("0x10", "integer", 16),
        ("1e3", "double", 1000.0),
        (".inf", "double", float("inf")),
        ("a text", "string", "a text"),
        ("'5'", "string", "5"),
        ("on", "string", "on"),
        ("[true, false]", "bool_array", (True, False)),
        ("[1, 2]", "integer_array", (1, 2)),
        ("[1, 2.5]", "double_array", (1.0, 2.5)),
        ("[a, b]", "string_array", ("a", "b")),
        ("[]", "bool_array", ()),
    ],
)
def test_a_text_represents_a_value_and_its_type(text: str, kind: str, value: object) -> None:
    assert parse_parameter(text) == NodeParameter(kind=kind, value=value)  # type: ignore[arg-type]
    assert kind in KINDS


@pytest.mark.parametrize("text", ["[1, a]", "[[1]]", "{a: 1}", "", "[true, 1]", "[", "9" * 20])
def test_impossible_parameters_are_misuse(text: str) -> None:
    with pytest.raises(MisuseError):
        parse_parameter(text)


@pytest.mark.parametrize(
    ("text", "wanted", "kind", "value"),
    [
        ("1", "double", "double", 1.0),
        ("[1, 2]", "double_array", "double_array", (1.0, 2.0)),
        ("[]", "string_array", "string_array", ()),
        ("[1, 255]", "byte_array", "byte_array", (1, 255)),
        ("on", "bool", "bool", True),
        ("No", "bool", "bool", False),
        ("5", "string", "string", "5"),
        ("1.50", "string", "string", "1.50"),
        ("true", "string", "string", "true"),
        # Values that do not match are left for the node to reject.
        ("1.5", "integer", "double", 1.5),
        ("true", "double", "bool", True),
        ("[300]", "byte_array", "integer_array", (300,)),
        ("5", "not set", "integer", 5),
    ],
)
def test_a_value_is_converted_to_the_parameters_type(
    text: str, wanted: str, kind: str, value: object
) -> None:
    fitted = fit_parameter(text, parse_parameter(text), wanted)
    assert fitted == NodeParameter(kind=kind, value=value)  # type: ignore[arg-type]
    assert type(fitted.value) is type(value)


@pytest.mark.parametrize(
    ("reason", "output"),
    [
        (
            "Wrong parameter type, expected 'Type.DOUBLE' got 'Type.STRING'",
            "a `string` was given",
        ),
        (
            "Wrong parameter type, parameter {gain} is of type {double}, setting it to {string} "
            "is not allowed.",
            "a `string` was given",
        ),
        ("the gain is above 10", "the gain is above 10"),
    ],
)
def test_a_rejection_has_the_nodes_own_message_not_that_of_a_library(
    reason: str, output: str
) -> None:
    assert refusal(reason, parse_parameter("fast")) == output
