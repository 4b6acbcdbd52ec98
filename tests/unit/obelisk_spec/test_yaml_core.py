"""YAML 1.2 core values, and `${NAME}` references in text."""

import math

import pytest

from obelisk_spec.yaml_core import YamlTextError, core_scalar, expand_variables, load_yaml_core


@pytest.mark.parametrize(
    "text", ["on", "off", "yes", "no", "On", "None", "y", "1_000", "0b1", "1:30"]
)
def test_values_that_only_yaml_1_1_converts_are_text(text: str) -> None:
    assert core_scalar(text) == text
    assert load_yaml_core(text) == text


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("012", 12),
        ("0o17", 15),
        ("0xFF", 255),
        ("-7", -7),
        ("+3", 3),
        ("1e-3", 0.001),
        (".5", 0.5),
        ("1.", 1.0),
        ("-.inf", -math.inf),
        ("TRUE", True),
        ("false", False),
        ("~", None),
        ("", None),
        ("Null", None),
    ],
)
def test_core_scalars(text: str, value: object) -> None:
    assert core_scalar(text) == value
    assert type(core_scalar(text)) is type(value)
    assert load_yaml_core(f"[{text}]" if text else "[~]") == [value]


def test_not_a_number_is_one() -> None:
    assert math.isnan(float(str(core_scalar(".nan"))))


def test_quoted_numbers_are_text() -> None:
    assert load_yaml_core("""{a: "1", b: 'true', c: !!str 2}""") == {
        "a": "1",
        "b": "true",
        "c": "2",
    }


def test_merge_keys_work() -> None:
    assert load_yaml_core("{<<: {a: 1, b: 1}, b: 2}") == {"a": 1, "b": 2}


def test_an_endless_number_is_text() -> None:
    digits = "9" * 5000
    assert core_scalar(digits) == digits


@pytest.mark.parametrize("text", ["!!python/name:os.system x", "{a: [", "a: b: c", "\x00"])
def test_unsafe_yaml_is_a_one_line_error(text: str) -> None:
    with pytest.raises(YamlTextError) as caught:
        load_yaml_core(text)
    assert "\n" not in str(caught.value)


def test_an_error_reports_its_location_and_its_cause() -> None:
    with pytest.raises(YamlTextError) as caught:
        load_yaml_core("data: 1\n dat: 2")
    assert str(caught.value) == "line 2, column 5: mapping values are not allowed here"


@pytest.mark.parametrize(
    "levels",
    [
        [f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]" for n in range(1, 60)],
        [f"a{n}: &a{n} {{<<: [*a{n - 1}, *a{n - 1}]}}" for n in range(1, 60)],
    ],
)
def test_exponential_aliases_are_rejected_immediately(levels: list[str]) -> None:
    with pytest.raises(YamlTextError, match=r"line \d+, column \d+: more than"):
        load_yaml_core("\n".join(["a0: &a0 {x: 1}", *levels]))


def test_a_value_that_contains_itself_is_rejected() -> None:
    with pytest.raises(YamlTextError, match=r"column 5: the alias `\*a` is inside its own value"):
        load_yaml_core("&a [*a]")


def test_aliases_have_the_value_of_their_anchor() -> None:
    assert load_yaml_core("[&a {x: 1}, *a, {<<: *a, y: 2}]") == [
        {"x": 1},
        {"x": 1},
        {"x": 1, "y": 2},
    ]


def test_references_are_replaced_and_other_text_is_kept() -> None:
    text = "${A}/$B/${C:-c}/${C:-}/${A:-a}/$${A}"
    assert expand_variables(text, {"A": "1"}) == "1/$B/c//1/${A}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("${A}", "environment variable `A` is not set"),
        ("${1}", "`${` does not start a `${NAME}`"),
    ],
)
def test_a_reference_without_a_value_is_an_error(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message.replace("$", r"\$").replace("{", r"\{")):
        expand_variables(text, {})


def test_unquoted_text_is_parsed_after_replacement() -> None:
    def expand(text: str) -> str:
        return expand_variables(text, {"N": "0.5"})

    assert load_yaml_core("[1, on]", expand) == [1, "on"]
    assert load_yaml_core("a: ${N}\nb: '${N}'\n", expand) == {"a": 0.5, "b": "0.5"}
    with pytest.raises(YamlTextError, match="`X` is not set"):
        load_yaml_core("a: ${X}", expand)
    assert load_yaml_core("a: ${N}") == {"a": "${N}"}
