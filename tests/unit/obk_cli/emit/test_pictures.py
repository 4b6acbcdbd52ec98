"""Mermaid, DOT, SVG, JSON and terminal output: content and escaping."""

import json
import re
from xml.etree import ElementTree

import pytest

from obk_cli.emit.graph import graph_of
from obk_cli.emit.graphviz import emit_dot, emit_svg
from obk_cli.emit.json import emit_graph_json
from obk_cli.emit.mermaid import emit_mermaid
from obk_cli.emit.terminal import emit_terminal
from obk_cli.errors import CommandFailedError
from obk_cli.install_source import install_command
from obk_cli.plan.plan import Endpoint, Plan
from obk_cli.terminal import columns_of, shortened

from .plans import loop, node

GRAPH = graph_of(loop())
SVG = "{http://www.w3.org/2000/svg}"


def svg_texts(text: str) -> list[str]:
    return [element.text or "" for element in ElementTree.fromstring(text).iter(f"{SVG}text")]


def test_the_graph_is_in_bring_up_order() -> None:
    assert [n.title for n in GRAPH.nodes] == [
        "obelisk_robot_a",
        "/left/obelisk_robot_b",
        "obelisk_estimation_0",
        "obelisk_control_0",
        "obelisk_joystick",
    ]
    assert [t.name for t in GRAPH.topics] == ["/q", "/ctrl", "/imu", "/est", "/joy"]


def test_sensors_are_reported_by_type() -> None:
    (imu,) = (topic for topic in GRAPH.topics if topic.name == "/imu")
    assert imu.summary == "T, 10 Hz"
    assert imu.sensors == ('gyro g"1 +1', "accelerometer <a>")


def test_every_picture_shows_every_node_topic_and_sensor() -> None:
    svg = "\n".join(svg_texts(emit_svg(GRAPH)))
    for text in (svg, emit_terminal(GRAPH)):
        for word in ("obelisk_robot_a", "/left/obelisk_robot_b", "/ctrl", "T, 10 Hz", "gyro g"):
            assert word in text
        assert "MuJoCo arm.xml" in text
        assert "accelerometer <a>" in text
        assert 'arm <"&">: 5 nodes, 5 topics' in text


def test_a_live_picture_has_a_line_for_measurements_in_every_box() -> None:
    groups = [*ElementTree.fromstring(emit_svg(GRAPH, is_live=True)).iter(f"{SVG}g")]
    named = {
        (kind, name): group
        for group in groups
        for kind in ("node", "topic")
        if (name := group.get(f"data-{kind}"))
    }
    expected = {("node", n.name) for n in GRAPH.nodes} | {("topic", t.name) for t in GRAPH.topics}
    assert set(named) == expected
    for group in named.values():
        *others, live = group.iter(f"{SVG}text")
        assert (live.get("class"), live.text) == ("live", None)
        assert max(float(text.attrib["y"]) for text in others) < float(live.attrib["y"])
    assert 'class="live"' not in emit_svg(GRAPH)


def test_boxes_of_a_picture_carry_their_section_or_topic_as_a_class() -> None:
    groups = ElementTree.fromstring(emit_svg(GRAPH)).iter(f"{SVG}g")
    classes = {group.get("data-node"): group.get("class") for group in groups}
    assert classes["/obelisk_robot_a"] == "node robot"
    assert classes["/obelisk_joystick"] == "node joystick"


def test_without_graphviz_a_picture_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(CommandFailedError) as failed:
        emit_svg(GRAPH)
    assert install_command("graph") in failed.value.help


def test_a_graphviz_that_fails_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("obk_cli.emit.graphviz.emit_dot", lambda *_, **__: "digraph {")
    with pytest.raises(CommandFailedError, match="Graphviz"):
        emit_svg(GRAPH)


def test_mermaid_names_unsupported_characters() -> None:
    text = emit_mermaid(GRAPH)
    assert "gyro g#quot;1 +1<br/>accelerometer #lt;a#gt;" in text
    assert 'title: "arm <\\"&\\">: 5 nodes, 5 topics"' in text
    # The text between quotes contains nothing that would end a label.
    for label in re.findall(r'\["(.*)"\]', text):
        assert '"' not in label
        assert not re.search(r"<(?!b>|/b>|br/>)", label)


def test_dot_escapes_special_characters() -> None:
    text = emit_dot(GRAPH)
    assert text.startswith('digraph "arm <\\"&amp;\\">" {')
    assert 'gyro g\\"1 +1\\naccelerometer <a>' in text


def test_topics_of_one_device_stand_with_it() -> None:
    within = {device: [t.name for t in GRAPH.topics_within(device)] for device in GRAPH.devices}
    assert within == {"onboard": ["/q", "/imu"], "offboard": ["/joy"]}
    assert [t.name for t in GRAPH.topics_within(None)] == ["/ctrl", "/est"]


def test_the_json_graph_names_each_edge() -> None:
    graph = json.loads(emit_graph_json(GRAPH))
    assert {"kind": "publishes", "from": "/obelisk_control_0", "to": "/ctrl"} in graph["edges"]
    assert {"kind": "subscribes", "from": "/ctrl", "to": "/obelisk_robot_a"} in graph["edges"]
    assert len(graph["edges"]) == 10
    names = {item["name"] for item in (*graph["nodes"], *graph["topics"])}
    assert {edge[end] for edge in graph["edges"] for end in ("from", "to")} <= names
    (imu,) = (topic for topic in graph["topics"] if topic["name"] == "/imu")
    assert imu["sensor_groups"][0]["sensors"] == {
        'g"1': "gyro",
        "g2": "gyro",
        "<a>": "accelerometer",
    }


@pytest.mark.parametrize(
    "letter", ["\x00", "\x1b", "\ud800", "\uffff", "\n", "]]>", "--", '"', "漢", "`"]
)
def test_any_character_gives_a_picture(letter: str) -> None:
    end = Endpoint(topic=f"/t{letter}", msg_type=f"a/msg/T{letter}")
    strange = node("robot", publishes=(end,), package=f"p{letter}", device=f"d{letter}")
    graph = graph_of(Plan(name=f"n{letter}", nodes=(strange,)))
    ElementTree.fromstring(emit_svg(graph).encode())
    for text in (emit_mermaid(graph), emit_dot(graph), emit_terminal(graph)):
        assert not re.search("[\x00-\x09\x0b-\x1f]", text)
        text.encode()
    lengths = {
        columns_of(line)
        for line in emit_terminal(graph).splitlines()
        if line.startswith(("╭", "│", "╰"))
    }
    assert len(lengths) <= 2  # with and without the mark of a topic without subscribers
    json.loads(emit_graph_json(graph).encode())


def test_a_plan_without_topics_has_pictures() -> None:
    graph = graph_of(Plan(name="x", nodes=(node("robot"),)))
    ElementTree.fromstring(emit_svg(graph))
    assert "obelisk_robot_0" in emit_terminal(graph)


def test_the_drawing_for_the_terminal_literally() -> None:
    plan = Plan(
        name="arm",
        nodes=(
            node("robot", publishes_to=("/q",), subscribes_to=("/u",)),
            node("control", publishes_to=("/u", "/debug"), subscribes_to=("/q",)),
        ),
    )
    assert emit_terminal(graph_of(plan), 52) == (
        "arm: 2 nodes, 3 topics\n"
        "\n"
        "onboard\n"
        "╭─ robot ──────────────────────────────────────╮\n"
        "│ obelisk_robot_0                         demo │\n"
        "│                                          run │\n"
        "│ ◀ /u                                T, 10 Hz ◀───╮\n"
        "│ ▶ /q                                T, 10 Hz ├─╮ │\n"
        "╰──────────────────────────────────────────────╯ │ │\n"
        "╭─ control ────────────────────────────────────╮ │ │\n"
        "│ obelisk_control_0                       demo │ │ │\n"
        "│                                          run │ │ │\n"
        "│ ◀ /q                                T, 10 Hz ◀─╯ │\n"
        "│ ▶ /u                                T, 10 Hz ├───╯\n"
        "│ ▶ /debug                            T, 10 Hz ├○\n"
        "╰──────────────────────────────────────────────╯\n"
    )


def test_a_line_that_crosses_a_rail_shows_both() -> None:
    (output,) = (line for line in emit_terminal(GRAPH).splitlines() if "▶ /ctrl" in line)
    assert output.endswith("├─┼───╯")


@pytest.mark.parametrize("width", [60, 80, 120])
def test_the_drawing_keeps_to_its_width(width: int) -> None:
    lines = emit_terminal(GRAPH, width).splitlines()
    assert max(map(columns_of, lines)) == width


@pytest.mark.parametrize("most", range(2, 12))
def test_shortened_text_fits(most: int) -> None:
    for text in ("", "abc", "abcdefghijkl", "漢字漢字漢字漢字"):
        assert columns_of(shortened(text, most)) <= most
    assert shortened("abcdefghijkl", 7) == "abc…jkl"
