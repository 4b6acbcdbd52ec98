"""Any order of events in a run: each subscription gets each message once, in order, none is lost.

Sockets, senders and receivers are real. DDS is a model: it matches both ends at different times,
delivers late but in order, and may drop a killed subscription at any time.
"""

import tempfile
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from unittest.mock import MagicMock

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule
from rclpy.qos import QoSProfile
from std_msgs.msg import Int64

from obelisk_py.core import local_sender as sender_module
from obelisk_py.core.executor.local_receiver import LocalReceiver
from obelisk_py.core.executor.worker import Worker
from obelisk_py.core.intra_process import MessageBuffer
from obelisk_py.core.local_sender import LocalSender, SubscriptionEndpoint
from obelisk_py.core.serialization.codec import codec_for
from obelisk_spec.local_transport.dds_reader import Sample
from obelisk_spec.local_transport.sockets import SocketFolder

PUBLISHER = bytes(range(16))
DEPTH = 10_000
CODEC = codec_for(Int64)
assert CODEC is not None
PACK = CODEC.pack


@dataclass(eq=False)
class Subscription:
    """A subscription in its own process."""

    gid: bytes
    is_of_run: bool
    got: list[int] = field(default_factory=list)
    is_listed: bool = True
    has_publisher: bool = False
    """Whether DDS has matched the publisher with it, also on the side of the subscription."""
    guaranteed: int | None = None
    """The first number that it must receive; None while DDS does not count it as matched."""
    is_alive: bool = True
    in_transit: deque[tuple[int, int]] = field(default_factory=deque)
    """Numbers that DDS has sent and messages that it has not received yet."""
    waiting: deque[Sample] = field(default_factory=deque)
    """The messages that DDS holds for it."""
    before_close: int | None = None
    """The number of messages received before it closed; others that had arrived are delivered."""
    receiver: LocalReceiver | None = None
    worker: Worker = field(default_factory=Worker)

    def open(self, folder: SocketFolder) -> None:
        reader = MagicMock(take=lambda: self.waiting.popleft() if self.waiting else None)
        qos = QoSProfile(depth=DEPTH)
        buffer = MessageBuffer(Int64, qos, CODEC)
        self.receiver = LocalReceiver(folder, self.gid, buffer, reader)
        self.worker.add(self.receiver, shared=False)

    def deliver(self) -> None:
        number, value = self.in_transit.popleft()
        self.waiting.append(Sample(PACK(Int64(data=value)), PUBLISHER, number, 0, 0))

    def run(self) -> None:
        """Run its executor."""
        if self.receiver is None:
            while not self.is_of_run and self.waiting:
                self.got.append(CODEC.unpack(self.waiting.popleft().data).data)
            return
        self.worker.run_ready(0)
        while (taken := self.receiver.take()) is not None:
            self.got.append(taken[0].data)

    def close(self) -> None:
        if self.receiver is not None:
            self.run()
            self.before_close = len(self.got)
            self.receiver.stop()
            self.run()
            self.worker.remove(self.receiver)
            self.receiver.close()
            self.receiver = None

    def kill(self) -> None:
        self.is_alive = False
        if self.receiver is not None:
            inbox = self.receiver._inbox
            inbox.listener.close()
            for connection in inbox.connections:
                connection.socket.close()
            self.receiver = None


class Run(RuleBasedStateMachine):
    """One publisher, and subscriptions inside and outside the run that come and go."""

    def __init__(self) -> None:
        super().__init__()
        self._patch = pytest.MonkeyPatch()
        self._folder = tempfile.TemporaryDirectory()
        path = Path(self._folder.name) / "sockets"
        path.mkdir(mode=0o700)
        self._sockets = SocketFolder(str(path))
        self._subscriptions: list[Subscription] = []
        self._ended: list[Subscription] = []
        self._published = 0
        self._through_dds = 0
        self._seen: list[Subscription] = []
        """The subscriptions that DDS had matched with the publisher at its last message."""
        self._patch.setattr(sender_module, "publisher_gid", lambda _handle: PUBLISHER)
        self._patch.setattr(sender_module, "subscriptions_of", lambda *_: self._endpoints())
        self._patch.setattr(LocalSender, "_has_ended", lambda _sender, gid: self._is_dead(gid))
        self._sender = LocalSender(
            self._sockets,
            node_handle=None,
            handle=None,
            topic="/numbers",
            type_name="x/msg/T",
            qos=QoSProfile(depth=DEPTH),
        )

    def _endpoints(self) -> list[SubscriptionEndpoint]:
        return [
            SubscriptionEndpoint(
                gid=each.gid,
                node=("node", "/"),
                type_name="x/msg/T",
                is_reliable=True,
                is_volatile=True,
            )
            for each in self._subscriptions
            if each.is_listed
        ]

    def _is_dead(self, gid: bytes) -> bool:
        return any(each.gid == gid and not each.is_alive for each in self._subscriptions)

    @property
    def _matched(self) -> list[Subscription]:
        return [each for each in self._subscriptions if each.guaranteed is not None]

    @property
    def _alive(self) -> list[Subscription]:
        return [each for each in self._subscriptions if each.is_alive]

    # --- the publisher

    @initialize(of_run=st.lists(st.sampled_from([True, True, True, False]), min_size=1, max_size=3))
    def start(self, of_run: list[bool]) -> None:
        for is_of_run in of_run:
            self.subscribe(is_of_run)

    @rule(count=st.sampled_from([1, 1, 2, 5, 400]))
    def publish(self, count: int) -> None:
        for _ in range(count):
            self._see_matched()
            matched = len(self._matched)
            bypass = self._sender.covers(matched, 0)
            value = self._published
            self._published += 1
            if not bypass or (
                self._sender.peers and not self._sender.send(PACK(Int64(data=value)))
            ):
                self._sender.send_through_dds(lambda value=value: self._send(value))

    def _see_matched(self) -> None:
        matched = self._matched
        new = [each for each in matched if each not in self._seen]
        if new and len(matched) == len(self._seen):
            # They replace killed ones: the publisher sees the same count, and may check later.
            for each in new:
                each.guaranteed = 10**9
        self._seen = matched

    def _send(self, value: int) -> None:
        self._through_dds += 1
        for each in self._matched:
            each.in_transit.append((self._through_dds, value))

    @rule()
    def wait(self) -> None:
        """Longer than the time between two checks of the publisher."""
        self._sender._next_check_s = 0.0

    # --- subscriptions

    @precondition(lambda self: len(self._alive) < 4)
    @rule(is_of_run=st.sampled_from([True, True, True, False]))
    def subscribe(self, is_of_run: bool) -> None:
        number = len(self._subscriptions) + len(self._ended)
        gid = bytes([99] * 12) + number.to_bytes(4, "big")
        self._subscriptions.append(Subscription(gid, is_of_run))

    @precondition(lambda self: self._alive)
    @rule()
    def settle(self) -> None:
        """Match all subscriptions and let them receive, so that a publisher may bypass DDS."""
        for each in self._alive:
            self._complete(each)
        for _ in range(3):
            self.wait()
            self.publish(1)
            for each in self._alive:
                while each.in_transit:
                    each.deliver()
                each.run()

    def _complete(self, each: Subscription) -> None:
        if each.guaranteed is None:
            each.guaranteed = self._published
        each.has_publisher = True
        if each.is_of_run and each.receiver is None:
            each.open(self._sockets)

    @precondition(lambda self: self._alive)
    @rule(data=st.data())
    def match_publisher(self, data: st.DataObject) -> None:
        each = data.draw(st.sampled_from(self._alive))
        if each.guaranteed is None:
            each.guaranteed = self._published

    @precondition(lambda self: self._alive)
    @rule(data=st.data())
    def match_subscription(self, data: st.DataObject) -> None:
        data.draw(st.sampled_from(self._alive)).has_publisher = True

    @precondition(lambda self: self._alive)
    @rule(data=st.data())
    def open(self, data: st.DataObject) -> None:
        each = data.draw(st.sampled_from(self._alive))
        if each.is_of_run and each.receiver is None:
            each.open(self._sockets)

    @precondition(lambda self: self._alive)
    @rule(data=st.data(), count=st.integers(1, 5))
    def deliver(self, data: st.DataObject, count: int) -> None:
        each = data.draw(st.sampled_from(self._alive))
        for _ in range(min(count, len(each.in_transit)) if each.has_publisher else 0):
            each.deliver()

    @precondition(lambda self: self._alive)
    @rule(data=st.data())
    def run_executor(self, data: st.DataObject) -> None:
        data.draw(st.sampled_from(self._alive)).run()

    # --- the end of subscriptions

    @precondition(lambda self: self._alive)
    @rule(data=st.data())
    def leave(self, data: st.DataObject) -> None:
        each = data.draw(st.sampled_from(self._alive))
        each.close()
        self._remove(each)

    @precondition(lambda self: self._alive)
    @rule(data=st.data())
    def kill(self, data: st.DataObject) -> None:
        data.draw(st.sampled_from(self._alive)).kill()

    @precondition(lambda self: len(self._alive) < len(self._subscriptions))
    @rule(data=st.data())
    def drop_killed(self, data: st.DataObject) -> None:
        dead = [each for each in self._subscriptions if not each.is_alive]
        self._remove(data.draw(st.sampled_from(dead)))

    def _remove(self, each: Subscription) -> None:
        self._subscriptions.remove(each)
        self._ended.append(each)

    def teardown(self) -> None:
        try:
            self._finish()
        finally:
            self._sender.close(0.0)
            for each in self._alive:
                each.kill()
            for each in (*self._subscriptions, *self._ended):
                each.worker.close()
            self._patch.undo()
            self._folder.cleanup()

    def _finish(self) -> None:
        self.settle()
        self.settle()
        for _ in range(DEPTH):  # a socket frees space only when it is read
            is_waiting = [peer.flush() for peer in self._sender.peers]
            for each in self._alive:
                each.run()
            if not any(is_waiting):
                break
        for each in self._alive:
            each.run()
            assert each.got[-1] == self._published - 1
            assert each.guaranteed is not None
            assert each.got[0] <= each.guaranteed
        for each in (*self._subscriptions, *self._ended):
            got = each.got[: each.before_close]
            assert got == list(range(got[0], got[0] + len(got))) if got else True
            assert each.got == sorted(set(each.got))


TestRun = Run.TestCase
TestRun.settings = settings(stateful_step_count=60)
