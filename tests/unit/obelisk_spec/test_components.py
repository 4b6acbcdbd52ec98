import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obelisk_spec.components import (
    SettingTextError,
    component_identity,
    component_spellings,
    format_component_setting,
    format_setting,
    parse_component_setting,
    parse_mapping,
    standard_component,
)
from obelisk_spec.yaml_core import load_yaml_core


def test_the_parameter_and_the_key_name_one_component() -> None:
    assert component_identity("pub_ctrl_setting") == component_identity("pub_ctrl") == "pub_ctrl"


@pytest.mark.parametrize("name", ["pub_ctrl", "pub_ctrl_setting", "publisher_ctrl"])
def test_the_seeds_other_name_is_found(name: str) -> None:
    assert set(component_spellings(name)) == {
        "pub_ctrl",
        "pub_ctrl_setting",
        "publisher_ctrl",
        "publisher_ctrl_setting",
    }


def test_a_custom_name_has_no_other_name() -> None:
    assert component_spellings("joystick_sub_setting") == ("joystick_sub", "joystick_sub_setting")


def test_the_base_classes_components_are_known_by_every_name() -> None:
    assert standard_component("subscriber_est") == "sub_est"
    assert standard_component("timer_ctrl_setting") == "timer_ctrl"
    assert standard_component("asdf") is None


def nested(scalars: st.SearchStrategy[object]) -> st.SearchStrategy[object]:
    return st.recursive(
        scalars,
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
        max_leaves=8,
    )


EXACT = st.none() | st.booleans() | st.integers(-(10**20), 10**20) | st.text()
SCALARS = EXACT | st.floats(allow_nan=False)
VALUES = nested(SCALARS)
FINITE = nested(EXACT | st.floats(allow_nan=False, allow_infinity=False))


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
def test_written_data_is_read_back_equal(value: dict[str, object]) -> None:
    text = format_setting(value)
    assert "\n" not in text
    assert parse_mapping(text) == value


@given(st.dictionaries(st.text(min_size=1) | st.sampled_from(["topic", "key"]), SCALARS | VALUES))
def test_a_components_settings_are_read_back_equal(value: dict[str, object]) -> None:
    assert parse_component_setting(format_component_setting(value)) == value


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        (
            {"key": "pub_ctrl", "topic": "/x", "history_depth": 10},
            "key:pub_ctrl,topic:/x,history_depth:10",
        ),
        ({"topic": "/{node}/x", "on": True, "timer_period_sec": 1e-3},
         "topic:/{node}/x,on:true,timer_period_sec:0.001"),
        ({"topic": "a,b"}, '{"topic": "a,b"}'),
        ({"topic": "a:b"}, '{"topic": "a:b"}'),
        ({"key": "10"}, '{"key": "10"}'),
        ({"key": ""}, '{"key": ""}'),
        ({"topic": "/x", "qos": {"depth": 1}}, '{"topic": "/x", "qos": {"depth": 1}}'),
        ({"fast-group": "ReentrantCallbackGroup"}, '{"fast-group": "ReentrantCallbackGroup"}'),
        ({}, "{}"),
    ],
)  # fmt: skip
def test_plain_settings_are_written_flat(settings: dict[str, object], text: str) -> None:
    assert format_component_setting(settings) == text


def test_code_that_splits_at_commas_and_colons_reads_flat_text() -> None:
    settings = {"key": "pub_ctrl", "topic": "/x", "msg_type": "sensor_msgs/msg/Imu"}
    fields = format_component_setting(settings).split(",")
    assert dict(field.split(":") for field in fields) == settings


@given(st.dictionaries(st.text(), FINITE, max_size=4))
def test_written_settings_are_json_and_yaml(setting: dict[str, object]) -> None:
    text = format_setting(setting)
    assert json.loads(text) == setting
    assert load_yaml_core(text) == setting


def test_nan_and_infinity_are_text_as_in_yaml() -> None:
    text = '{"key": NaN, "topic": -Infinity}'
    assert parse_mapping(text) == load_yaml_core(text) == {"key": "NaN", "topic": "-Infinity"}


@pytest.mark.parametrize("opening", ["[", '{"a": '])
def test_deeply_nested_text_is_an_error(opening: str) -> None:
    with pytest.raises(SettingTextError):
        parse_mapping('{"key": ' + opening * 100_000)
