"""References in a text: what stands for them, and what does not."""

import pytest

from obelisk_spec.yaml_core import YamlTextError, expand_variables, load_yaml_core


def test_references_are_replaced_and_all_else_is_left_alone() -> None:
    text = "${A}/$B/${C:-c}/${C:-}/${A:-a}/$${A}"
    assert expand_variables(text, {"A": "1"}) == "1/$B/c//1/${A}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("${A}", "environment variable `A` is not set"),
        ("${1}", "`${` does not begin a `${NAME}`"),
    ],
)
def test_a_reference_that_nothing_stands_for_is_an_error(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message.replace("$", r"\$").replace("{", r"\{")):
        expand_variables(text, {})


def test_what_is_written_without_quotes_is_read_after_it_was_replaced() -> None:
    def expand(text: str) -> str:
        return expand_variables(text, {"N": "0.5"})

    assert load_yaml_core("[1, on]", expand) == [1, "on"]
    assert load_yaml_core("a: ${N}\nb: '${N}'\n", expand) == {"a": 0.5, "b": "0.5"}
    with pytest.raises(YamlTextError, match="`X` is not set"):
        load_yaml_core("a: ${X}", expand)
    assert load_yaml_core("a: ${N}") == {"a": "${N}"}
