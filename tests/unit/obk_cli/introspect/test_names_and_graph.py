"""Names that a user types, and reports of a graph."""

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.introspect.publishing import robots_commanded_by
from obk_cli.introspect.resolve import matching_names, matching_nodes, resolve_one
from obk_cli.plan.plan import Endpoint, Plan
from obk_cli.ros.graph import (
    GraphEndpoint,
    GraphSnapshot,
    Role,
    TopicInfo,
    ends_that_need_dds,
    incompatible_endpoints,
    parameter_nodes,
    special_services,
    visible,
)
from obk_cli.ros.meters import stamp_getter
from obk_cli.ros.raw_subscription import OfferedQos

from ..plans import node  # noqa: TID252 - shared by folders of tests
from ..ros.definitions import Message, fields_of  # noqa: TID252 - shared by folders of tests

TOPICS = ("/a/est", "/b/est", "/a/ctrl", "/obelisk_robot_0/rtf")


def end(
    node: str,
    role: Role,
    reliability: str = "reliable",
    durability: str = "volatile",
    msg_type: str = "pkg/msg/State",
) -> GraphEndpoint:
    qos = OfferedQos(
        history="keep_last",
        depth=10,
        reliability=reliability,
        durability=durability,
        liveliness="automatic",
        deadline_ns=0,
        lifespan_ns=0,
        lease_ns=0,
    )
    return GraphEndpoint(node=node, role=role, msg_type=msg_type, qos=qos)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("/a/est", ("/a/est",)),
        ("a/est", ("/a/est",)),
        ("ctrl", ("/a/ctrl",)),
        ("est", ("/a/est", "/b/est")),
        ("robot_0/rtf", ("/obelisk_robot_0/rtf",)),
        ("/est", ()),
        ("st", ()),
    ],
)
def test_a_name_matches_itself_or_names_that_end_in_it(
    name: str, expected: tuple[str, ...]
) -> None:
    assert matching_names(name, TOPICS) == expected


def test_an_ambiguous_or_unknown_name_is_reported_with_the_existing_ones() -> None:
    with pytest.raises(CommandFailedError) as several:
        resolve_one("topic", "est", TOPICS, 7)
    assert several.value.help == "choose one of `/a/est`, `/b/est`"
    with pytest.raises(CommandFailedError) as none:
        resolve_one("topic", "/a/esst", TOPICS, 7)
    assert none.value.message == "no topic `/a/esst` in ROS domain 7"
    assert none.value.help is not None
    assert none.value.help.startswith("did you mean `/a/est`")


def test_incompatible_endpoints_are_reported() -> None:
    topic = TopicInfo(
        name="/t",
        msg_types=("pkg/msg/State",),
        publishers=(end("/p", "publisher", "best_effort"),),
        subscriptions=(
            end("/weak", "subscription", "best_effort"),
            end("/strong", "subscription", "reliable", "transient_local"),
        ),
    )
    assert list(incompatible_endpoints(topic)) == [
        "/strong does not receive from /p: it requests `reliable`, but `best_effort` is offered",
        "/strong does not receive from /p: "
        "it requests `transient_local`, but `volatile` is offered",
    ]


def test_hidden_names_and_those_of_every_node_are_left_out() -> None:
    services = {
        "/n/list_parameters": ("rcl_interfaces/srv/ListParameters",),
        "/n/reset": ("std_srvs/srv/Trigger",),
        "/act/_action/send_goal": ("x/action/A_SendGoal",),
    }
    topics = (TopicInfo(name="/t", msg_types=()), TopicInfo(name="/act/_action/x", msg_types=()))
    graph = GraphSnapshot(topics=topics, services=services)
    assert [topic.name for topic in visible(graph).topics] == ["/t"]
    assert set(visible(graph).services) == {"/n/list_parameters", "/n/reset"}
    assert set(special_services(services)) == {"/n/reset", "/act/_action/send_goal"}
    assert parameter_nodes(graph) == ("/n",)


def test_robots_that_listen_to_a_topic_are_known_by_plan_or_by_name() -> None:
    subscribes = {"subscribes": (Endpoint(topic="/c", msg_type=None),)}
    plan = Plan(name="arm", nodes=(node("arm", "robot", **subscribes), node("k", **subscribes)))
    topic = TopicInfo(
        name="/c",
        msg_types=(),
        subscriptions=(end("/obelisk_robot_0", "subscription"), end("/k", "subscription")),
    )
    assert robots_commanded_by(topic, [plan]) == ("/arm", "/obelisk_robot_0")
    assert robots_commanded_by(TopicInfo(name="/d", msg_types=()), [plan]) == ()


def test_stamps_are_found_by_type() -> None:
    message = Message(header=Message(stamp=Message(sec=2, nanosec=5)))
    assert stamp_getter("pkg/State", fields_of)(message) == 2_000_000_005
    with pytest.raises(CommandFailedError, match="pkg/Point has no header and no stamp"):
        stamp_getter("pkg/Point", fields_of)


def test_a_typo_in_a_short_name_is_reported_with_the_full_name() -> None:
    with pytest.raises(CommandFailedError) as caught:
        resolve_one("topic", "ctlr", TOPICS, 7)
    assert caught.value.help == "did you mean `/a/ctrl`?"


def test_received_types_are_the_published_ones() -> None:
    talks, subscribes = end("/a", "publisher"), end("/b", "subscription", msg_type="pkg/msg/Other")
    types = (talks.msg_type, subscribes.msg_type)
    seen = TopicInfo(name="/t", msg_types=types, publishers=(talks,), subscriptions=(subscribes,))
    assert seen.published_types == ("pkg/msg/State",)
    silent = TopicInfo(name="/t", msg_types=(subscribes.msg_type,), subscriptions=(subscribes,))
    assert silent.published_types == ("pkg/msg/Other",)


def test_a_topic_needs_dds_for_a_subscription_without_a_socket_and_for_late_joiners() -> None:
    def subscription(node: str, gid: str) -> GraphEndpoint:
        return GraphEndpoint(
            node=node, role="subscription", msg_type="a/msg/B", qos=offer("volatile"), gid=gid
        )

    def offer(durability: str) -> OfferedQos:
        return OfferedQos(
            history="keep_last",
            depth=1,
            reliability="reliable",
            durability=durability,
            liveliness="automatic",
            deadline_ns=0,
            lifespan_ns=0,
            lease_ns=0,
        )

    def topic(durability: str, *subscriptions: GraphEndpoint) -> TopicInfo:
        source = GraphEndpoint(
            node="/s", role="publisher", msg_type="a/msg/B", qos=offer(durability)
        )
        return TopicInfo(
            name="/t", msg_types=("a/msg/B",), publishers=(source,), subscriptions=subscriptions
        )

    inside, outside = subscription("/inside", "01"), subscription("/outside", "02")
    sockets = {"01", "03"}
    assert not list(ends_that_need_dds(topic("volatile", inside), sockets))
    assert list(ends_that_need_dds(topic("volatile", inside, outside), sockets)) == [
        "/outside has no socket in a run"
    ]
    assert list(ends_that_need_dds(topic("transient_local", inside), sockets)) == [
        "/s offers transient_local"
    ]


NODES = ("/arm/obelisk_control_0", "/obelisk_robot_0", "/obelisk_robot_1", "/estimation", "/talker")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("control", ("/arm/obelisk_control_0",)),
        ("robot", ("/obelisk_robot_0", "/obelisk_robot_1")),
        ("robot_1", ("/obelisk_robot_1",)),
        ("arm/control_0", ("/arm/obelisk_control_0",)),
        ("leg/control_0", ()),
        ("estimation", ("/estimation",)),
        ("/control", ()),
        ("sensing", ()),
    ],
)
def test_a_section_means_its_nodes(name: str, expected: tuple[str, ...]) -> None:
    assert matching_nodes(name, NODES) == expected


def test_a_section_of_several_nodes_is_ambiguous_and_a_misspelled_one_suggests_its_node() -> None:
    with pytest.raises(CommandFailedError, match="`robot` is ambiguous") as ambiguous:
        resolve_one("node", "robot", NODES, 0)
    assert "`/obelisk_robot_0`" in (ambiguous.value.help or "")
    assert "`/obelisk_robot_1`" in (ambiguous.value.help or "")
    with pytest.raises(CommandFailedError, match="no node `contrl`") as unknown:
        resolve_one("node", "contrl", NODES, 0)
    assert "`/arm/obelisk_control_0`" in (unknown.value.help or "")
