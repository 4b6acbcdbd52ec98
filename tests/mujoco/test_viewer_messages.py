"""Sending states of a simulation to a viewer, through a real pair of sockets."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
import pytest

from obelisk_py.core.sim.mujoco.viewers.viewer_messages import (
    SIGNATURE,
    States,
    StateSender,
    receive_message,
    send_message,
    send_report,
)

pytestmark = pytest.mark.mujoco

MOVED_BY_OTHERS = """
<mujoco>
  <size nuserdata="2"/>
  <worldbody>
    <body name="target" mocap="true"><geom size="0.1"/></body>
    <body><joint name="elbow"/><geom size="0.1" pos="0 0 1"/></body>
  </worldbody>
  <actuator><motor joint="elbow"/></actuator>
</mujoco>
"""


@contextmanager
def link() -> Iterator[tuple[socket.socket, socket.socket]]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        yield ours, theirs


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MOVED_BY_OTHERS)


def test_the_received_state_is_identical_and_so_are_derived_values(
    model: mujoco.MjModel,
) -> None:
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:], data.time = 0.3, -2.0, 0.7, 1.5
    data.mocap_pos[:], data.userdata[:] = (1.0, 2.0, 3.0), (4.0, 5.0)
    with link() as (ours, theirs):
        states = States(model, theirs)
        StateSender(model, data, ours, lambda *_: None).send()
        assert states.take_next(timeout_s=5.0)
    mujoco.mj_forward(model, data)
    for name in ("qpos", "qvel", "ctrl", "mocap_pos", "userdata", "geom_xpos", "geom_xmat"):
        assert np.array_equal(getattr(states.data, name), getattr(data, name)), name
    assert states.data.time == 1.5


def test_until_the_first_state_the_model_is_in_its_initial_state(model: mujoco.MjModel) -> None:
    with link() as (_, theirs):
        states = States(model, theirs)
        assert not states.take_next(timeout_s=0.01)
        assert not states.take_newest(timeout_s=0.01)
        assert not states.is_over
        assert states.data.geom_xpos[1].tolist() == [0.0, 0.0, 1.0]


def test_states_arrive_in_order_or_only_the_latest(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    with link() as (ours, theirs):
        states, sender = States(model, theirs), StateSender(model, data, ours, lambda *_: None)
        for time_s in (1.0, 2.0, 3.0, 4.0):
            data.time = time_s
            sender.send()
        assert states.take_next()
        assert states.data.time == 1.0
        assert states.take_newest(timeout_s=5.0)
        assert states.data.time == 4.0
        assert (sender.sent, sender.dropped) == (4, 0)


def test_reports_between_states_change_none_of_them(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    with link() as (ours, theirs):
        states, sender = States(model, theirs), StateSender(model, data, ours, lambda *_: None)
        for time_s in (1.0, 2.0):
            data.time = time_s
            sender.send()
            send_report(ours, f"after {time_s:g}" + "." * 4000)
        while not states.reports or states.data.time < 2.0:
            states.take_newest(timeout_s=5.0)
            assert states.data.time in (1.0, 2.0)
        states.take_newest(timeout_s=0.0)
    assert [report.rstrip(".") for report in states.reports] == ["after 1", "after 2"]


def test_a_report_to_a_viewer_that_has_ended_does_nothing() -> None:
    with link() as (ours, theirs):
        theirs.close()
        send_report(ours, "paused")


def test_a_stalled_viewer_does_not_block_and_its_losses_are_counted(
    model: mujoco.MjModel,
) -> None:
    data = mujoco.MjData(model)
    with link() as (ours, theirs):
        states, sender = States(model, theirs), StateSender(model, data, ours, lambda *_: None)
        while sender.dropped < 5:
            data.time += 1.0
            sender.send()
        sent = sender.sent
        assert sent > 0
        for number in range(1, sent + 1):
            assert states.take_next()
            assert states.data.time == number
        assert not states.take_next(timeout_s=0.0)
        sender.send()
        assert states.take_next()


def test_after_the_last_state_it_is_over(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    with link() as (ours, theirs):
        states = States(model, theirs)
        StateSender(model, data, ours, lambda *_: None).send()
        ours.close()
        assert states.take_newest(timeout_s=5.0)
        assert not states.take_newest(timeout_s=5.0)
        assert states.is_over


def test_sending_to_a_viewer_that_has_ended_does_nothing(model: mujoco.MjModel) -> None:
    received: list[tuple[str, str]] = []
    with link() as (ours, theirs):
        sender = StateSender(model, mujoco.MjData(model), ours, lambda *args: received.append(args))
        theirs.close()
        sender.send()
        sender.send()
    assert (sender.sent, sender.dropped, received) == (0, 0, [])


def with_user_data(count: int) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f'<mujoco><size nuserdata="{count}"/></mujoco>')


def test_a_state_of_100_kilobytes_arrives() -> None:
    large = with_user_data(12_500)
    data = mujoco.MjData(large)
    data.userdata[-1] = 3.0
    with link() as (ours, theirs):
        states = States(large, theirs)
        StateSender(large, data, ours, lambda *_: None).send()
        assert states.take_next(timeout_s=5.0)
    assert states.data.userdata[-1] == 3.0


def test_a_state_too_large_for_a_packet_is_reported_once() -> None:
    large = with_user_data(2_000_000)
    received: list[tuple[str, str]] = []
    with link() as (ours, _):
        room = ours.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)
        size = (1 + mujoco.mj_stateSize(large, SIGNATURE)) * 8
        sender = StateSender(large, mujoco.MjData(large), ours, lambda *args: received.append(args))
        sender.send()
        sender.send()
    ((severity, text),) = received
    assert severity == "warning"
    assert text.startswith(f"a state of this model has {size} bytes, but a socket on this machine ")
    assert f"accepts at most {room} at once" in text
    assert "sysctl -w net.core.wmem_max=" in text


def test_texts_use_the_same_link_until_it_ends() -> None:
    with link() as (ours, theirs):
        send_message(theirs, "info", "shown at http://127.0.0.1:8080")
        send_message(theirs, "warning", "größer: als")
        theirs.close()
        assert receive_message(ours) == ("info", "shown at http://127.0.0.1:8080")
        assert receive_message(ours) == ("warning", "größer: als")
        assert receive_message(ours) is None


def test_the_last_message_is_received_if_states_are_unread() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        with theirs:
            ours.send(b"a state")
            send_message(theirs, "warning", "no display")
        assert receive_message(ours) == ("warning", "no display")
        assert receive_message(ours) is None
