"""What one process tells another of a ROS graph, told and read back."""

import json

import pytest

from obk_cli.looking.graph import End, Graph, TopicSeen
from obk_cli.looking.parameters import NOT_SET, Parameter
from obk_cli.looking.told import (
    GraphTold,
    NodeEnds,
    emit_graph,
    emit_parameter,
    parse_graph,
    parse_parameter_told,
)
from obk_cli.ros.raw_subscription import Offer

OFFER = Offer(
    history="keep_last",
    depth=10,
    reliability="reliable",
    durability="volatile",
    liveliness="automatic",
    deadline_ns=2**63 - 1,
    lifespan_ns=2**63 - 1,
    lease_ns=2**63 - 1,
)
TALKER = End(node="/talker", role="publisher", msg_type="p/msg/M", qos=OFFER, type_hash="RIHS01_0")
TOLD = GraphTold(
    graph=Graph(
        nodes=("/talker", "/talker"),
        topics=(TopicSeen(name="/q", msg_types=("p/msg/M",), publishers=(TALKER,)),),
        services={"/talker/get_state": ("p/srv/S", "p/srv/T")},
    ),
    nodes={
        "/talker": NodeEnds(
            publishes={"/q": ("p/msg/M",)},
            subscribes={},
            services={"/talker/get_state": ("p/srv/S",)},
        )
    },
)


def test_a_graph_is_read_back() -> None:
    assert parse_graph(json.loads(json.dumps(emit_graph(TOLD)))) == TOLD


@pytest.mark.parametrize("key", ["nodes", "topics", "services", "ends"])
def test_a_graph_of_another_shape_is_none(key: str) -> None:
    told = json.loads(json.dumps(emit_graph(TOLD)))
    assert parse_graph({**told, key: 7}) is None
    del told[key]
    assert parse_graph(told) is None


@pytest.mark.parametrize(
    "parameter",
    [
        Parameter(kind="double", value=1.5),
        Parameter(kind="double", value=float("inf")),
        Parameter(kind="bool", value=True),
        Parameter(kind="string_array", value=("a", "b")),
        Parameter(kind="byte_array", value=(0, 255)),
        Parameter(kind=NOT_SET, value=None),
    ],
)
def test_a_parameter_is_read_back(parameter: Parameter) -> None:
    told = json.loads(json.dumps(emit_parameter(parameter)))
    assert parse_parameter_told(told) == parameter


@pytest.mark.parametrize("data", [None, 7, {}, {"kind": "colour", "value": "red"}])
def test_a_parameter_of_another_shape_is_none(data: object) -> None:
    assert parse_parameter_told(data) is None
