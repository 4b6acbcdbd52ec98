import pytest
from hypothesis import given
from hypothesis import strategies as st

from obelisk_spec.settings import (
    SettingTextError,
    format_setting,
    parse_component_setting,
    parse_mapping,
)

SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(10**20), 10**20)
    | st.floats(allow_nan=False)
    | st.text()
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=8,
)


@pytest.mark.parametrize(
    ("text", "settings"),
    [
        ("{topic: /x, history_depth: 10}", {"topic": "/x", "history_depth": 10}),
        ('{"topic": "/x", "on": true}', {"topic": "/x", "on": True}),
        ("topic:/x,history_depth:10", {"topic": "/x", "history_depth": 10}),
        ("topic: /x, timer_period_sec: 1e-3", {"topic": "/x", "timer_period_sec": 0.001}),
        ("topic:/a:b/c,callback_group:None", {"topic": "/a:b/c", "callback_group": "None"}),
        ("topic:/x,", {"topic": "/x"}),
        ("topic: /x\nkey: on\n", {"topic": "/x", "key": "on"}),
        ("", {}),
    ],
)
def test_both_forms_are_read(text: str, settings: dict[str, object]) -> None:
    assert parse_component_setting(text) == settings


@pytest.mark.parametrize("text", ["{topic: /x", "/x", "topic /x", "{1: x}", "[a]\n[b]"])
def test_other_text_is_an_error_that_quotes_it(text: str) -> None:
    with pytest.raises(SettingTextError) as caught:
        parse_component_setting(text)
    assert repr(text) in str(caught.value)


@given(st.dictionaries(st.text(), VALUES, max_size=4))
def test_what_is_written_is_read_back_equal(value: dict[str, object]) -> None:
    text = format_setting(value)
    assert "\n" not in text
    assert parse_mapping(text) == value


def test_written_text_is_as_plain_as_it_can_be() -> None:
    setting = {"topic": "/x", "callback_group": "None", "qos": {"depth": 1}, "on": "true"}
    written = '{topic: /x, callback_group: None, qos: {depth: 1}, on: "true"}'
    assert format_setting(setting) == written
