"""Requests and replies of the control socket as lines."""

import json

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from obelisk_spec.runtime_protocol import Rate
from obk_cli.runs.protocol import (
    LONGEST_REASON,
    ChangeAnswer,
    ChangeRequest,
    Fault,
    GraphAnswer,
    GraphRequest,
    Member,
    NodeStatus,
    Request,
    StackStatus,
    StatusRequest,
    Stopping,
    StopRequest,
    change_data,
    decode_answer,
    decode_request,
    encode_line,
)

STATUS = StackStatus(
    name="dummy",
    state="activating",
    phase="ready",
    seconds=1.5,
    nodes=(
        NodeStatus(
            node="/a",
            section="control",
            device="onboard",
            state="inactive",
            process="/a",
            pid=7,
            restarts=1,
            hangs=True,
            rates=(
                Rate(
                    name="timer",
                    expected_hz=100.0,
                    measured_hz=99.5,
                    ticks=7,
                    overruns=1,
                    late_p50_us=1.0,
                    late_p99_us=2.0,
                    late_max_us=3.0,
                ),
            ),
        ),
    ),
)
ANSWER = ChangeAnswer(
    success=False,
    why="/a: no",
    members=(Member(node="/a", result="refused", state="inactive", fault="no"),),
)


FAULT = Fault(error="the stack has ended")


@pytest.mark.parametrize(
    "request_",
    [
        StatusRequest(),
        StopRequest(reason="requested by `obk stop`"),
        ChangeRequest(transition="activate"),
        ChangeRequest(transition="cleanup", nodes=("/a", "/b"), timeout_s=2.5),
    ],
)
def test_a_request_is_one_line_and_read_back(request_: Request) -> None:
    line = encode_line(request_)
    assert line.index(b"\n") == len(line) - 1
    assert decode_request(line) == request_


def test_a_question_about_the_graph_travels_as_it_is() -> None:
    question = b'{"about":"graph"}'
    line = encode_line(GraphRequest(question=msgspec.Raw(question)))
    assert json.loads(line) == {"ask": "look", "question": {"about": "graph"}}
    request = decode_request(line)
    assert isinstance(request, GraphRequest)
    assert bytes(request.question) == question
    answer = decode_answer(encode_line(GraphAnswer(value=msgspec.Raw(question))), GraphAnswer)
    assert isinstance(answer, GraphAnswer)
    assert bytes(answer.value) == question


@pytest.mark.parametrize("answer", [STATUS, ANSWER, Stopping(), FAULT])
def test_an_answer_is_read_back(answer: object) -> None:
    line = encode_line(answer)  # type: ignore[arg-type]
    assert decode_answer(line, type(answer)) == answer


def test_the_wire_format_is_that_of_other_versions() -> None:
    assert json.loads(encode_line(StatusRequest())) == {"ask": "status"}
    change = ChangeRequest(transition="activate", nodes=("/a",))
    expected = {"ask": "change", "transition": "activate", "nodes": ["/a"]}
    assert json.loads(encode_line(change)) == expected
    assert json.loads(encode_line(STATUS))["answer"] == "status"
    assert json.loads(encode_line(ANSWER))["answer"] == "change"
    assert json.loads(encode_line(Stopping())) == {"answer": "stopping"}
    assert json.loads(encode_line(FAULT)) == {"error": "the stack has ended"}


def test_an_answer_of_a_later_version_is_read_as_far_as_it_is_known() -> None:
    line = encode_line(STATUS).replace(b'"pid":7', b'"pid":7,"colour":"red"')
    assert b"colour" in line
    assert decode_answer(line, StackStatus) == STATUS


@pytest.mark.parametrize(
    "nodes",
    [["/a"], {}, 7, [{"node": "/a"}], [{**msgspec.to_builtins(STATUS.nodes[0]), "pid": "7"}]],
)
def test_a_reply_of_another_shape_is_none(nodes: object) -> None:
    data = {**msgspec.to_builtins(STATUS), "nodes": nodes}
    assert decode_answer(json.dumps(data).encode(), StackStatus) is None


def test_a_reply_to_another_request_is_none() -> None:
    assert decode_answer(encode_line(STATUS), ChangeAnswer) is None
    assert decode_answer(encode_line(Stopping()), StackStatus) is None


def test_invalid_utf8_breaks_no_reply() -> None:
    answer = ChangeAnswer(success=False, why="/a: \udcff")
    assert decode_answer(encode_line(answer), ChangeAnswer) == ChangeAnswer(
        success=False, why="/a: ?"
    )


def test_a_status_has_a_time_that_json_can_hold() -> None:
    endless = msgspec.structs.replace(STATUS, seconds=float("inf"))
    assert decode_answer(encode_line(endless), StackStatus) == msgspec.structs.replace(
        STATUS, seconds=0.0
    )


def test_the_data_of_a_change_is_independent_of_the_wire_format() -> None:
    assert list(change_data(ANSWER)) == ["success", "why", "members"]
    assert change_data(ANSWER)["members"][0]["result"] == "refused"


@pytest.mark.parametrize(
    ("line", "place"),
    [
        (b"", ""),
        (b"\xff\xfe", ""),
        (b"[" * 60_000, ""),
        (b'{"ask":' * 60_000, ""),
        (b"{}", "`ask`"),
        (b'{"ask": ["stop"]}', "$.ask"),
        (b'{"ask": "dance"}', "$.ask"),
        (b'{"ask": "stop", "reason": 1}', "$.reason"),
        (b'{"ask": "change", "transition": ["activate"]}', "$.transition"),
        (b'{"ask": "change", "transition": "activate", "nodes": "/a"}', "$.nodes"),
        (b'{"ask": "change", "transition": "activate", "nodes": [7]}', "$.nodes[0]"),
    ],
)
def test_an_invalid_request_is_answered_by_a_fault_with_its_location(
    line: bytes, place: str
) -> None:
    fault = decode_request(line)
    assert isinstance(fault, Fault)
    assert fault.error.startswith("invalid request: ")
    assert place in fault.error


@pytest.mark.parametrize("timeout", ["0", "-1", "NaN", "Infinity", "true", '"2"', "1e9"])
def test_a_timeout_is_seconds(timeout: str) -> None:
    line = f'{{"ask": "change", "transition": "activate", "timeout_s": {timeout}}}'
    assert isinstance(decode_request(line.encode()), Fault)


def test_a_long_reason_is_cut() -> None:
    line = encode_line(StopRequest(reason="x" * 10_000))
    assert decode_request(line) == StopRequest(reason="x" * LONGEST_REASON)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_request_or_a_fault(line: bytes) -> None:
    decode_request(line)
    decode_answer(line, StackStatus)
    decode_answer(line, ChangeAnswer)
