"""Whatever the graph: boxes lie apart, inside of their bands, and no line crosses a box."""

from itertools import combinations, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obk_cli.emit.graph import GraphNode, graph_of
from obk_cli.emit.layout import Box, Layout, lay_out
from obk_cli.emit.placement import place_apart
from obk_cli.emit.ranks import rank_nodes
from obk_cli.plan.plan import TIERS, Plan, Process

from .plans import loop, node

TOPICS = st.lists(st.sampled_from([f"/t{i}" for i in range(8)]), max_size=4, unique=True)


@st.composite
def plans(draw: st.DrawFn) -> Plan:
    count = draw(st.integers(1, 9))
    return Plan(name="x", processes=tuple(_process(draw, i) for i in range(count)))


def _process(draw: st.DrawFn, number: int) -> Process:
    return node(
        draw(st.sampled_from(TIERS)),
        str(number),
        says=tuple(draw(TOPICS)),
        hears=tuple(draw(TOPICS)),
        device=draw(st.sampled_from(["onboard", "offboard"])),
    )


def layout(plan: Plan) -> Layout:
    return lay_out(graph_of(plan), lambda item: (100.0 + len(item.title), 40.0))


def overlap(a: Box, b: Box) -> bool:
    beside = a.x + a.width < b.x or b.x + b.width < a.x
    return not beside and not (a.y + a.height < b.y or b.y + b.height < a.y)


def is_inside(box: Box, x: float, y: float) -> bool:
    return box.x < x < box.x + box.width and box.y < y < box.y + box.height


@given(plans())
def test_boxes_lie_apart_and_inside_of_their_bands(plan: Plan) -> None:
    drawn = layout(plan)
    assert not any(overlap(a, b) for a, b in combinations(drawn.boxes, 2))
    bands = {band.device: band for band in drawn.bands}
    for box in drawn.boxes:
        assert box.x >= 0
        assert box.x + box.width <= drawn.width
        if isinstance(box.item, GraphNode):
            band = bands[box.item.device]
            assert band.y < box.y
            assert box.y + box.height < band.y + band.height


@given(plans())
def test_no_line_crosses_a_box(plan: Plan) -> None:
    drawn = layout(plan)
    for way in drawn.ways:
        for (x0, y0), (x1, y1) in pairwise(way.points):
            for share in (0.1, 0.3, 0.5, 0.7, 0.9):
                # A bend stays between the heights and sides of its ends, in a gutter without boxes.
                x, y = x0 + (x1 - x0) * share, y0 + (y1 - y0) * share
                assert not any(is_inside(box, x, y) for box in drawn.boxes)


@given(plans())
def test_every_end_of_a_topic_has_its_line(plan: Plan) -> None:
    graph = graph_of(plan)
    ends = sum(len(topic.publishers) + len(topic.subscribers) for topic in graph.topics)
    assert len(layout(plan).ways) == ends


def test_data_flows_to_the_right_and_back_below() -> None:
    ranks = rank_nodes(graph_of(loop()))
    assert ranks == {
        "/obelisk_robot_a": 0,
        "/left/obelisk_robot_b": 0,
        "/obelisk_estimation_0": 1,
        "/obelisk_joystick": 1,
        "/obelisk_control_0": 2,
    }
    back = [way for way in layout(loop()).ways if way.is_return]
    assert [way.section for way in back] == ["control"]


def test_a_node_stands_right_of_those_of_its_section_that_it_hears() -> None:
    chain = [
        node("control", str(i), says=(f"/c{i}",), hears=(f"/c{i + 1}",) if i < 999 else ())
        for i in range(1000)
    ]
    ranks = rank_nodes(graph_of(Plan(name="x", processes=tuple(chain))))
    assert ranks["/obelisk_control_999"] == 0
    assert ranks["/obelisk_control_0"] == 999


def test_a_circle_within_a_section_has_an_order_too() -> None:
    circle = (
        node("control", "a", says=("/a",), hears=("/b",)),
        node("control", "b", says=("/b",), hears=("/a",)),
    )
    assert rank_nodes(graph_of(Plan(name="x", processes=circle))) == {
        "/obelisk_control_a": 1,
        "/obelisk_control_b": 0,
    }


@pytest.mark.parametrize(
    ("wishes", "places"),
    [
        ([5.0], [5.0]),
        ([5.0, 5.0], [0.0, 10.0]),
        ([3.0, 1.0, 40.0], [0.0, 10.0, 40.0]),
        ([90.0, 99.0], [89.5, 99.5]),
        ([99.0, 99.0], [90.0, 100.0]),
    ],
)
def test_places_are_near_the_wishes_and_apart(wishes: list[float], places: list[float]) -> None:
    assert place_apart(wishes, [10.0] * (len(wishes) - 1), 0.0, 100.0) == places
