"""The topics that a plan expects."""

from collections.abc import Iterable

import pytest

from obk_cli.monitor.expected_topics import PlannedTopic, planned_topics, simulated_robots
from obk_cli.plan.plan import Endpoint, Plan, PlannedNode

from ..plans import node  # noqa: TID252 - shared by folders of tests


def end(topic: str, rate_hz: float | None = None, msg_type: str | None = "p/msg/M") -> Endpoint:
    return Endpoint(topic=topic, msg_type=msg_type, rate_hz=rate_hz)


def process(
    name: str,
    section: str,
    publishes: Iterable[Endpoint],
    subscribes: Iterable[Endpoint],
    **more: object,
) -> PlannedNode:
    ends = {"publishes": tuple(publishes), "subscribes": tuple(subscribes)}
    return node(name, section, namespace="/arm", **ends, **more)


def plan_of(*processes: PlannedNode) -> Plan:
    return Plan(name="arm", nodes=processes)


def test_topics_are_in_the_order_of_the_data_with_their_expected_rates() -> None:
    plan = plan_of(
        process("c", "control", [end("/ctrl", 100.0)], [end("/est")]),
        process("e", "estimation", [end("/est", 50.0)], [end("/q"), end("/imu")]),
        process("r", "robot", [end("/q", 1000.0), end("/imu", None)], [end("/ctrl")]),
    )
    topics = planned_topics(plan)
    assert [topic.name for topic in topics] == ["/imu", "/q", "/est", "/ctrl"]
    assert topics[2] == PlannedTopic(
        name="/est",
        msg_type="p/msg/M",
        expected_hz=50.0,
        publishers=("/arm/e",),
        made_from=("/q", "/imu"),
    )
    assert topics[0].expected_hz is None
    assert topics[1].made_from == ()


def test_topics_with_two_publishers_are_expected_from_both() -> None:
    one, other = process("a", "control", [end("/x", 10.0)], []), end("/x", 5.0)
    both = planned_topics(plan_of(one, process("b", "control", [other], [])))
    assert both[0].expected_hz == 15.0
    without = process("b", "control", [end("/x")], [])
    assert planned_topics(plan_of(one, without))[0].expected_hz is None


def wanted_at(*factors: float | str) -> dict[str, float | None]:
    """The expected topics for a robot with each factor, and for nodes with and without its time."""
    robots = [
        process(
            f"r{number}",
            "robot",
            [end(f"/q{number}", 1000.0)],
            [],
            model="arm.xml",
            parameters={"realtime_factor": factor},
        )
        for number, factor in enumerate(factors)
    ]
    follows = {"parameters": {"use_sim_time": True}}
    nodes = [
        process("e", "estimation", [end("/est", 500.0)], [end("/q0")], **follows),
        process("c", "control", [end("/ctrl", 100.0)], [end("/est")]),
    ]
    return {topic.name: topic.expected_hz for topic in planned_topics(plan_of(*robots, *nodes))}


def test_rates_of_simulated_time_are_expected_at_its_speed() -> None:
    assert wanted_at(0.5) == {"/q0": 500.0, "/est": 250.0, "/ctrl": 100.0}
    assert wanted_at(1) == {"/q0": 1000.0, "/est": 500.0, "/ctrl": 100.0}


def test_a_speed_that_was_set_since_counts_instead_of_the_plans() -> None:
    robot = process(
        "r", "robot", [end("/q", 1000.0)], [], model="m.xml", parameters={"realtime_factor": 1.0}
    )
    follower = process("n", "control", [end("/u", 10.0)], [], parameters={"use_sim_time": True})
    plan = plan_of(robot, follower)
    (name,) = simulated_robots(plan)
    wanted = {topic.name: topic.expected_hz for topic in planned_topics(plan, {name: 0.5})}
    assert (name, wanted) == ("/arm/r", {"/q": 500.0, "/u": 5.0})


@pytest.mark.parametrize(("measured", "share"), [(0.99, 1.0), (1.1, 1.0), (0.4, 0.4), (0.0, None)])
def test_a_simulation_that_is_too_slow_is_not_the_fault_of_its_topics(
    measured: float, share: float | None
) -> None:
    robot = process("r", "robot", [end("/q", 1000.0)], [], model="m.xml")
    follower = process("n", "control", [end("/u", 10.0)], [], parameters={"use_sim_time": True})
    other = process("w", "control", [end("/w", 10.0)], [])
    topics = planned_topics(plan_of(robot, follower, other), measured={"/arm/r": measured})
    scaled = {"/q": None, "/u": None} if share is None else {"/q": 1000 * share, "/u": 10 * share}
    assert {topic.name: topic.expected_hz for topic in topics} == {**scaled, "/w": 10.0}


def test_simulations_as_fast_as_possible_are_not_judged() -> None:
    assert wanted_at(0) == {"/q0": None, "/est": None, "/ctrl": 100.0}


def test_the_clock_of_a_node_is_unknown_with_several_speeds() -> None:
    assert wanted_at(0.5, 2.0) == {"/q0": 500.0, "/q1": 2000.0, "/est": None, "/ctrl": 100.0}


def test_nodes_that_feed_each_other_have_an_order_too() -> None:
    a = process("a", "control", [end("/a")], [end("/b")])
    b = process("b", "control", [end("/b")], [end("/a")])
    assert {topic.name for topic in planned_topics(plan_of(a, b))} == {"/a", "/b"}


def test_a_type_that_only_one_end_knows_is_known() -> None:
    a = process("a", "control", [end("/x", msg_type=None)], [])
    b = process("b", "robot", [], [end("/x")])
    assert planned_topics(plan_of(a, b))[0].msg_type == "p/msg/M"


def test_a_plan_without_nodes_has_no_topics() -> None:
    assert planned_topics(plan_of()) == ()


def test_at_an_invalid_speed_nothing_is_judged() -> None:
    assert wanted_at(".inf") == {"/q0": None, "/est": None, "/ctrl": 100.0}
