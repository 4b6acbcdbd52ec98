"""Settings of components: their sources, and errors in them."""

import re
from typing import Any

import pytest
from rclpy.qos import QoSReliabilityPolicy

from obelisk_py.core.command_watchdog import StalePolicy
from obelisk_py.core.components import ComponentKind, ComponentTable, RegisteredComponent
from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.settings import (
    check_component,
    find_settings,
    parse_node_settings,
    stale_policy,
    timer_settings,
    topic_settings,
)

NOTHING = parse_node_settings("")


def publisher(**changes: Any) -> RegisteredComponent:
    values: dict[str, Any] = {"ros_parameter": "pub_ctrl_setting", "key": None, **changes}
    return RegisteredComponent(kind=ComponentKind.PUBLISHER, **values)


def test_its_parameter_wins_over_the_entry_and_the_default() -> None:
    node = parse_node_settings("publishers: [{key: pub_ctrl, topic: /entry}]")
    component = publisher(default="{topic: /default}")
    assert find_settings(component, "{topic: /own}", node) == {"key": "pub_ctrl", "topic": "/own"}
    assert find_settings(component, "", node) == {"key": "pub_ctrl", "topic": "/entry"}
    assert find_settings(component, " ", NOTHING) == {"topic": "/default"}
    assert find_settings(publisher(), "", NOTHING) is None


@pytest.mark.parametrize("identity", ["key: pub_ctrl", "ros_parameter: pub_ctrl_setting"])
def test_key_and_ros_parameter_name_the_same_component(identity: str) -> None:
    node = parse_node_settings(f"publishers: [{{{identity}, topic: /x}}]")
    for component in (publisher(), publisher(ros_parameter=None, key="pub_ctrl")):
        settings = find_settings(component, "", node)
        assert settings is not None
        assert settings["topic"] == "/x"


def test_the_matching_one_of_several_entries_is_used() -> None:
    node = parse_node_settings("publishers: [{key: pub_a, topic: /a}, {key: pub_b, topic: /b}]")
    settings = find_settings(publisher(ros_parameter=None, key="pub_b"), "", node)
    assert settings == {"key": "pub_b", "topic": "/b"}


def test_an_entry_of_another_kind_is_not_taken() -> None:
    node = parse_node_settings("subscribers: [{key: pub_ctrl, topic: /x}]")
    assert find_settings(publisher(), "", node) is None


def test_the_old_flat_form_is_read() -> None:
    raw = find_settings(publisher(), "topic:/x,history_depth:3", NOTHING)
    assert raw == {"topic": "/x", "history_depth": 3}


def test_defaults_are_ten_deep_reliable_in_the_default_group() -> None:
    settings = topic_settings(publisher(), {"topic": "/x", "callback_group": "None"})
    assert settings.qos.depth == 10
    assert settings.qos.reliability == QoSReliabilityPolicy.RELIABLE
    assert settings.callback_group is None


def test_qos_is_taken() -> None:
    raw = {"topic": "/x", "qos": {"reliability": "best_effort", "history_depth": 2}}
    qos = topic_settings(publisher(), raw).qos
    assert (qos.depth, qos.reliability) == (2, QoSReliabilityPolicy.BEST_EFFORT)


@pytest.mark.parametrize(
    ("raw", "sentence"),
    [
        ({}, "has no `topic`"),
        ({"topic": "/a b"}, "invalid topic name `/a b`: ' ' is not a letter"),
        ({"topic": "/x/{nod}"}, "invalid topic name `/x/{nod}`: '{' is not a letter"),
        ({"topic": "/x", "history_depth": 0}, "`history_depth` is 0, expected a whole number"),
        ({"topic": "/x", "history_depth": True}, "`history_depth` is True"),
        ({"topic": "/x", "history_depth": 2**31}, "from 1 to 2147483647"),
        ({"topic": "/x", "qos": 3}, "`qos` is 3, expected a mapping"),
        (
            {"topic": "/x", "qos": {"reliability": "maybe"}},
            "expected one of: reliable, best_effort",
        ),
    ],
)
def test_bad_topic_settings_name_the_component_and_the_value(
    raw: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ObeliskConfigError, match=sentence) as error:
        topic_settings(publisher(), raw)
    assert "publisher `pub_ctrl_setting`" in str(error.value)


@pytest.mark.parametrize("period", [0, -1, True, "fast", None])
def test_a_period_is_a_number_above_zero(period: object) -> None:
    timer = RegisteredComponent(
        kind=ComponentKind.TIMER, ros_parameter=None, key="timer_ctrl", callback=lambda: None
    )
    with pytest.raises(ObeliskConfigError, match="expected a number of seconds above 0"):
        timer_settings(timer, {"timer_period_sec": period})


@pytest.mark.parametrize(
    ("raw", "policy"),
    [
        ({}, None),
        ({"max_age_sec": 1}, StalePolicy(max_age_s=1.0, action="zero")),
        ({"max_age_sec": 0.1, "stale_action": "damp"}, StalePolicy(max_age_s=0.1, action="damp")),
    ],
)
def test_the_maximum_age_of_a_command_is_read(
    raw: dict[str, object], policy: StalePolicy | None
) -> None:
    assert stale_policy(publisher(), raw) == policy


@pytest.mark.parametrize(
    ("raw", "fault"),
    [
        ({"max_age_sec": 0}, "`max_age_sec` is 0, expected a number of seconds above 0"),
        ({"max_age_sec": -1.0}, "`max_age_sec` is -1.0, expected a number of seconds above 0"),
        ({"max_age_sec": True}, "`max_age_sec` is True, expected a number of seconds above 0"),
        (
            {"max_age_sec": float("nan")},
            "`max_age_sec` is nan, expected a number of seconds above 0",
        ),
        ({"stale_action": "hold"}, "`max_age_sec` is None, expected a number of seconds above 0"),
        (
            {"max_age_sec": 1, "stale_action": "explode"},
            "`stale_action` is `explode`; expected one of: zero, hold, damp",
        ),
    ],
)
def test_an_invalid_age_or_action_is_named(raw: dict[str, object], fault: str) -> None:
    with pytest.raises(
        ObeliskConfigError, match=re.escape(f"the publisher `pub_ctrl_setting`: {fault}")
    ):
        stale_policy(publisher(), raw)


@pytest.mark.parametrize(
    "text",
    ["[1]", "publishers: 3", "publishers: [x]", "callback_groups: [a]", "callback_groups: {a: B}"],
)
def test_obelisk_settings_of_another_shape_are_rejected(text: str) -> None:
    with pytest.raises(ObeliskConfigError):
        parse_node_settings(text)


@pytest.mark.parametrize(
    ("own", "settings"),
    [("{key: 3, topic: /x}", ""), ("", "publishers: [{key: 3, topic: /x}]")],
)
def test_a_key_that_is_not_text_is_named(own: str, settings: str) -> None:
    with pytest.raises(ObeliskConfigError, match="`key` is 3, expected a string"):
        check_component(publisher(), own, settings)


def test_a_table_finds_every_format_and_lists_existing_names() -> None:
    table: ComponentTable[int] = ComponentTable(ComponentKind.PUBLISHER)
    table.add("pub_ctrl", publisher().names | {"asdf"}, 7)
    for name in ("pub_ctrl", "pub_ctrl_setting", "publisher_ctrl", "asdf"):
        assert table[name] == 7
    assert list(table) == ["pub_ctrl"]
    with pytest.raises(KeyError, match="no publisher `nope`; existing: pub_ctrl"):
        table["nope"]
