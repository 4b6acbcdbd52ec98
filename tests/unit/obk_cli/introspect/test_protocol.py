"""Requests about a ROS graph and their replies, written and read back."""

import json

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.introspect.protocol import (
    FailedReply,
    GraphReply,
    KnownGraph,
    NamesReply,
    NodeEndpoints,
    SetReply,
    WireParameter,
    decode_reply,
    graph_of,
    graph_reply,
    parameter_of,
    wire_parameter,
)
from obk_cli.ros.graph import GraphEndpoint, GraphSnapshot, TopicInfo
from obk_cli.ros.parameters import NOT_SET, NodeParameter
from obk_cli.ros.raw_subscription import OfferedQos
from obk_cli.runs.protocol import decode, encode

OFFER = OfferedQos(
    history="keep_last",
    depth=10,
    reliability="reliable",
    durability="volatile",
    liveliness="automatic",
    deadline_ns=2**63 - 1,
    lifespan_ns=2**63 - 1,
    lease_ns=2**63 - 1,
)
TALKER = GraphEndpoint(
    node="/talker", role="publisher", msg_type="p/msg/M", qos=OFFER, type_hash="RIHS01_0"
)
KNOWN = KnownGraph(
    graph=GraphSnapshot(
        nodes=("/talker", "/talker"),
        topics=(TopicInfo(name="/q", msg_types=("p/msg/M",), publishers=(TALKER,)),),
        services={"/talker/get_state": ("p/srv/S", "p/srv/T")},
    ),
    nodes={
        "/talker": NodeEndpoints(
            publishes={"/q": ("p/msg/M",)},
            subscribes={},
            services={"/talker/get_state": ("p/srv/S",)},
        )
    },
)


def test_a_graph_is_read_back() -> None:
    assert graph_of(decode_reply(encode(graph_reply(KNOWN)), GraphReply)) == KNOWN


@pytest.mark.parametrize("key", ["nodes", "topics", "services", "endpoints"])
def test_a_graph_of_another_shape_is_an_error(key: str) -> None:
    data = json.loads(encode(graph_reply(KNOWN)))
    with pytest.raises(CommandFailedError, match=rf"\$\.{key}"):
        decode_reply(json.dumps({**data, key: 7}).encode(), GraphReply)
    del data[key]
    with pytest.raises(CommandFailedError, match=f"`{key}`"):
        decode_reply(json.dumps(data).encode(), GraphReply)


def test_a_failure_is_raised_with_the_launchers_message() -> None:
    data = encode(FailedReply(failed="/arm did not answer", help="look"))
    with pytest.raises(CommandFailedError, match="/arm did not answer") as failed:
        decode_reply(data, NamesReply)
    assert failed.value.help == "look"


@pytest.mark.parametrize(
    "parameter",
    [
        NodeParameter(kind="double", value=1.5),
        NodeParameter(kind="double", value=float("inf")),
        NodeParameter(kind="double_array", value=(1.0, float("-inf"))),
        NodeParameter(kind="bool", value=True),
        NodeParameter(kind="string_array", value=("a", "b")),
        NodeParameter(kind="byte_array", value=(0, 255)),
        NodeParameter(kind=NOT_SET, value=None),
    ],
)
def test_a_parameter_is_read_back(parameter: NodeParameter) -> None:
    wire = decode(encode(wire_parameter(parameter)), WireParameter)
    assert parameter_of(wire) == parameter


@pytest.mark.parametrize(
    "wire",
    [
        WireParameter(kind="colour", value="red"),
        WireParameter(kind="double", value="red"),
        WireParameter(kind="double", value=(1.0,)),
        WireParameter(kind="string_array", value="red"),
        WireParameter(kind="double_array", value=("red",)),
    ],
)
def test_a_parameter_of_another_shape_is_an_error(wire: WireParameter) -> None:
    with pytest.raises(CommandFailedError, match=wire.kind):
        parameter_of(wire)


@pytest.mark.parametrize("data", [b"", b"7", b"[]", b"{}", b"\xff", b'{"reason":' * 10_000])
def test_invalid_bytes_of_a_reply_are_an_error(data: bytes) -> None:
    with pytest.raises(CommandFailedError, match="invalid answer"):
        decode_reply(data, SetReply)
