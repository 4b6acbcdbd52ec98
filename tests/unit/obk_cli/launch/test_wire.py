"""Requests and answers of the control socket as lines."""

import json
from dataclasses import asdict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obelisk_spec.runtime_protocol import Rate
from obk_cli.launch.answers import emit_answer, parse_change, parse_status
from obk_cli.launch.asks import ChangeAnswer, Member, NodeStatus, StackStatus
from obk_cli.launch.wire import (
    ChangeRequest,
    LookRequest,
    Request,
    StatusRequest,
    StopRequest,
    emit_fault,
    emit_look,
    emit_request,
    is_stop_heard,
    parse_look,
    parse_request,
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
                    wanted_hz=100.0,
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


@pytest.mark.parametrize(
    "request_",
    [
        StatusRequest(),
        StopRequest(reason="asked by `obk stop`"),
        ChangeRequest(transition="activate"),
        ChangeRequest(transition="cleanup", nodes=("/a", "/b"), timeout_s=2.5),
        LookRequest(question={"about": "graph"}),
    ],
)
def test_a_request_is_one_line_and_read_back(request_: Request) -> None:
    line = emit_request(request_)
    assert line.index(b"\n") == len(line) - 1
    assert parse_request(line) == request_


def test_answers_are_read_back() -> None:
    assert parse_status(emit_answer(STATUS)) == STATUS
    assert parse_change(emit_answer(ANSWER)) == ANSWER
    assert is_stop_heard(emit_answer(None))
    assert parse_look(emit_look({"names": ["gain"]})) == {"names": ["gain"]}


def test_an_answer_of_a_later_version_is_read_as_far_as_it_is_known() -> None:
    line = emit_answer(STATUS).replace(b'"pid": 7', b'"pid": 7, "colour": "red"')
    assert parse_status(line) == STATUS


@pytest.mark.parametrize(
    "nodes", [["/a"], {}, 7, [{"node": "/a"}], [{**asdict(STATUS.nodes[0]), "pid": "7"}]]
)
def test_an_answer_of_another_shape_is_none(nodes: object) -> None:
    told = {**asdict(STATUS), "nodes": nodes}
    assert parse_status(json.dumps(told).encode()) is None


def test_a_fault_is_no_state_and_a_failed_change() -> None:
    line = emit_fault("the stack has ended")
    assert parse_status(line) is None
    assert parse_change(line) == ChangeAnswer(success=False, why="the stack has ended")
    assert parse_look(line) is None
    assert not is_stop_heard(line)


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        (b"", "a request is one line with a JSON object"),
        (b"\xff\xfe", "a request is one line with a JSON object"),
        (b"[" * 60_000, "a request is one line with a JSON object"),
        (b"{}", "`ask` is `status`, `change`, `look` or `stop`, not null"),
        (b'{"ask": ["stop"]}', '`ask` is `status`, `change`, `look` or `stop`, not ["stop"]'),
        (b'{"ask": "stop", "reason": 1}', "`reason` is a text"),
        (
            b'{"ask": "change", "transition": ["activate"]}',
            "`transition` is one of configure, activate, deactivate, cleanup, shutdown",
        ),
        (
            b'{"ask": "change", "transition": "activate", "nodes": "/a"}',
            "`nodes` is a list of full names",
        ),
    ],
)
def test_what_is_no_request_is_told(line: bytes, fault: str) -> None:
    assert parse_request(line) == fault


@pytest.mark.parametrize("timeout", ["0", "-1", "NaN", "Infinity", "true", '"2"', "1e9"])
def test_a_timeout_is_seconds(timeout: str) -> None:
    line = f'{{"ask": "change", "transition": "activate", "timeout_s": {timeout}}}'
    assert parse_request(line.encode()) == (
        "`timeout_s` is a number of seconds above 0, at most 3600"
    )


@given(st.binary(max_size=200))
def test_any_bytes_are_a_request_or_a_fault(line: bytes) -> None:
    parse_request(line)
    parse_status(line)
    parse_change(line)
