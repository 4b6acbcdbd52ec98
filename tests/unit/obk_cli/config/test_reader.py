"""Reading a tree into the typed config."""

import pytest

from obk_cli.config.model import Stack
from obk_cli.config.reader import read_stack
from obk_cli.config.yaml_parser import parse_source
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import SourceFile

NODE = "pkg: demo, executable: run"


def read(text: str) -> tuple[Stack, list[Diagnostic]]:
    parsed = parse_source(SourceFile.of("f.yaml", text))
    assert parsed.tree is not None, parsed.diagnostics
    stack, faults = read_stack(parsed.tree)
    assert stack is not None, faults
    return stack, list(faults)


def node_faults(fields: str) -> list[str]:
    _, faults = read(f"control: {{{NODE}, {fields}}}")
    return [fault.message for fault in faults]


def test_both_formats_give_the_same_nodes() -> None:
    flat, _ = read(f"control: [{{{NODE}}}]\nrobot: {{{NODE}}}")
    blocks, _ = read(f"onboard:\n  control: {{{NODE}}}\n  robot: [{{{NODE}}}]")
    assert [n.full_name for n in flat.nodes] == [n.full_name for n in blocks.nodes]
    assert {n.device for n in flat.nodes} == {n.device for n in blocks.nodes} == {"onboard"}


def test_nodes_are_counted_through_over_all_devices() -> None:
    stack, faults = read(
        f"a: {{control: [{{{NODE}}}, {{{NODE}, name: mpc}}]}}\nb: {{control: {{{NODE}}}}}"
    )
    assert [n.node_name for n in stack.nodes] == [
        "obelisk_control_0",
        "obelisk_control_mpc",
        "obelisk_control_2",
    ]
    assert [n.device for n in stack.nodes] == ["a", "a", "b"]
    assert faults == []


def test_a_namespace_is_prepended() -> None:
    stack, _ = read(f"control: {{{NODE}, namespace: left/arm}}")
    assert stack.nodes[0].full_name == "/left/arm/obelisk_control_0"


def test_null_equals_a_missing_value() -> None:
    stack, faults = read(f"control: [{{{NODE}, publishers: , callback_groups: , params: ~}}]\nviz:")
    assert faults == []
    assert stack.nodes[0].components == ()


def test_the_word_none_is_no_callback_group() -> None:
    timer = "timers: [{key: t, timer_period_sec: 1, callback_group: None}]"
    stack, faults = read(f"control: {{{NODE}, {timer}}}")
    assert faults == []
    assert stack.nodes[0].components[0].callback_group is None
    assert stack.nodes[0].components[0].timer_period_s is not None


@pytest.mark.parametrize(
    ("params", "parameters"),
    [
        ("{a: {b: {c: 1}}}", {"a.b.c": 1}),
        ("{a: [1, 2.5]}", {"a": (1.0, 2.5)}),
        ("{a: [on, off], b: true, c: 0.5}", {"a": ("on", "off"), "b": True, "c": 0.5}),
    ],
)
def test_parameters(params: str, parameters: dict[str, object]) -> None:
    stack, _ = read(f"control: {{{NODE}, params: {params}}}")
    assert {p.name: p.value for p in stack.nodes[0].params} == parameters


def test_a_name_with_dots_and_a_nested_one_are_one_parameter() -> None:
    stack, (fault,) = read(f"control: {{{NODE}, params: {{a.b: 1, a: {{b: 2, c: 3}}}}}}")
    assert (fault.code, fault.message) == ("OBK004", "parameter `a.b` is given twice")
    assert (fault.span.column, fault.related[0].span.column) == (60, 48)
    assert {p.name: p.value for p in stack.nodes[0].params} == {"a.b": 1, "a.c": 3}


@pytest.mark.parametrize(
    "value",
    ["~", "[]", "[1, ~]", "[1, x]", "[[1]]", "[{a: 1}]", "[true, 1]", "99999999999999999999"],
)
def test_a_parameter_that_ros_cannot_hold_is_a_finding(value: str) -> None:
    _, faults = read(f"control: {{{NODE}, params: {{a: {value}}}}}")
    assert [fault.code for fault in faults] == ["OBK113"]


def test_remappings_are_a_mapping_or_a_list() -> None:
    for written in ("{/a: /b}", "['/a:=/b']"):
        stack, faults = read(f"control: {{{NODE}, remappings: {written}}}")
        assert [(r.old, r.new) for r in stack.nodes[0].remappings] == [("/a", "/b")]
        assert faults == []
    fault = "a remapping is the string `/a`, expected `from:=to`"
    assert node_faults("remappings: [/a]") == [fault]


def test_names_that_are_remapped_are_those_of_topics() -> None:
    assert node_faults("remappings: {/a b: /c, /d: 2e}") == [
        "`/a b` cannot be a topic name: ' ' is not a letter, digit or `_`",
        "`2e` cannot be a topic name: `2e` starts with a digit",
    ]
    assert node_faults("remappings: ['/a := /b']") == [
        "`/a ` cannot be a topic name: ' ' is not a letter, digit or `_`",
        "` /b` cannot be a topic name: ' ' is not a letter, digit or `_`",
    ]
    assert node_faults("remappings: ['__ns:=/x', 'other:/a:=/b', '~/a:=b']") == []


def test_environment_values_are_text_as_written() -> None:
    stack, faults = read(f"control: {{{NODE}, env: {{A: 012, B: on, C: '1'}}}}")
    assert stack.nodes[0].env == (("A", "012"), ("B", "on"), ("C", "1"))
    assert faults == []


def test_every_fault_of_a_node_is_found_in_one_run() -> None:
    assert node_faults("log_level: loud, respawn: yes, publishers: [{topic: 3}], nme: x") == [
        "`nme` is not a valid key of a node of `control`",
        "this publisher has neither `ros_parameter` nor `key`",
        "`topic` is the number 3, expected text",
        "`log_level` is `loud`, expected one of `debug`, `info`, `warn`, `error`, `fatal`",
        "`respawn` is the string `yes`, expected `true` or `false`",
    ]


@pytest.mark.parametrize(
    ("field", "help"),
    [
        ("respawn: 'true'", "remove the quotes: `true`"),
        ('publishers: [{key: p, topic: /t, history_depth: "10"}]', "`10`"),
        ("timers: [{key: t, timer_period_sec: '1e-3'}]", "`1e-3`"),
        ("timers: [{key: t, timer_period_sec: '1 ms'}]", None),
        ("respawn: on", "in YAML 1.2 `on` is text; write `true` or `false`"),
    ],
)
def test_values_that_are_text_only_by_quotes_are_reported_without_them(
    field: str, help: str | None
) -> None:
    _, (fault,) = read(f"control: {{{NODE}, {field}}}")
    assert fault.code == "OBK103"
    assert (fault.help or "").endswith(help or "")
    assert bool(fault.help) == bool(help)


def test_a_misspelled_key_is_read_as_the_intended_one() -> None:
    stack, faults = read("control: {pgk: demo, executable: run}")
    assert [fault.code for fault in faults] == ["OBK101"]
    assert stack.nodes[0].pkg is not None
    assert stack.nodes[0].pkg.value == "demo"


def test_the_name_of_a_joystick_may_be_empty() -> None:
    stack, faults = read(f'control: {{{NODE}}}\njoystick: {{on: true, device_name: ""}}')
    assert faults == []
    assert [p.value for p in stack.joysticks[0].params] == [""]


def test_an_empty_text_in_place_of_a_number_has_no_quotes_to_remove() -> None:
    _, faults = read(f'control: {{{NODE}}}\njoystick: {{on: true, device_id: ""}}')
    assert [(fault.code, fault.help) for fault in faults] == [("OBK103", None)]


def test_disabled_parts_are_missing() -> None:
    stack, faults = read(
        f"viz: {{on: false, viz_nodes: [{{{NODE}}}]}}\njoystick: {{on: false, pub_topic: /joy}}"
    )
    assert stack.nodes == ()
    assert [j.on for j in stack.joysticks] == [False]
    assert faults == []


def test_the_older_name_of_a_sensor_groups_type_is_read() -> None:
    group = "{topic: /s, dt: 1, sensor_type: ObkImu, sensor_names: {a: gyro}}"
    sim = f"sim: {{model_xml_path: m.xml, sensor_settings: [{group}]}}"
    stack, faults = read(f"robot: {{{NODE}, {sim}}}")
    assert [fault.code for fault in faults] == ["OBK501"]
    block = stack.nodes[0].sims[0].block
    assert block["sensor_settings"] == [
        {"topic": "/s", "dt": 1, "msg_type": "ObkImu", "sensor_names": {"a": "gyro"}}
    ]
    assert stack.nodes[0].sims[0].is_sound


def test_a_block_with_a_fault_is_invalid() -> None:
    stack, _ = read(f"robot: {{{NODE}, sim: {{model_xml_path: m.xml, n_u: -1}}}}")
    assert not stack.nodes[0].sims[0].is_sound


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("3", "the file contains the number 3, not a config"),
        ("[a]", "the file contains a list, not a config"),
        ("{pattern: {}, site_name: x}", "this is a ray-caster file, not a config"),
        ("{qqqqq: 1}", "the file contains `qqqqq`, none of which is a section of a config"),
    ],
)
def test_a_document_that_is_no_config_is_named_by_its_kind(text: str, message: str) -> None:
    parsed = parse_source(SourceFile.of("f.yaml", text))
    assert parsed.tree is not None
    stack, faults = read_stack(parsed.tree)
    assert stack is None
    assert [fault.message for fault in faults] == [message]
