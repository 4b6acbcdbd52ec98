"""Replay recorded messages at the pace at which they were published."""

import os
import struct
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from obelisk_recordings.chunks import RecordedMessage, messages_in_order
from obelisk_recordings.clock import RecordedClock
from obelisk_recordings.run import RecordedRun
from obelisk_spec.runtime_protocol import CLOCK_TOPIC
from obelisk_spec.suggestions import list_names
from obk_cli.errors import CommandFailedError
from obk_cli.ros.graph import UNNAMED, TopicInfo

if TYPE_CHECKING:
    from obk_cli.introspect.target import GraphTarget
    from obk_cli.ros.participant import RosParticipant
    from obk_cli.ros.publisher import RosPublisher

__all__ = ["Played", "command_topics", "play", "playable_topics", "refuse_live_topic"]

_DEPTH: Final = 1000
"""Queue depth for a slow subscription: one second of a fast topic."""
_CHECK_S: Final = 1.0
"""Interval between checks for robots [s]."""
_TICK_S: Final = 0.001
_SILENT_WAIT_S: Final = 1.0
"""How long to wait for nodes before saying so [s]."""
_QUIET_S: Final = 0.5
_NS_PER_S: Final = 1_000_000_000
_COMMANDS: Final = "obelisk_control_msgs/"
"""Messages of this package command robots, whatever the topic's name."""
_LOGS: Final = ("/rosout", "/parameter_events")
"""Every node publishes on these topics, and none acts on them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Played:
    """The result of a replay."""

    counts: dict[str, int]
    """Topic -> messages."""
    first_ns: int
    """When the first message was published in the recorded run [ns since 1970]."""
    start_ns: int
    """When it was replayed [ns since 1970]."""
    seconds: float
    """Duration of the replay [s]."""


def command_topics(run: RecordedRun) -> frozenset[str]:
    """The recorded topics that command a robot, according to the run's config or to their type."""
    planned = inputs_of(run, lambda section: section == "robot")
    typed = {one.topic for one in run.bag.topics if one.msg_type.startswith(_COMMANDS)}
    return frozenset(planned & set(run.topics) | typed)


def _is_robot(node: str) -> bool:
    return "/obelisk_robot_" in node  # of a stack on another host, only names are known


def inputs_of(run: RecordedRun, selects: Callable[[object], bool]) -> set[str]:
    """The topics with a subscriber in the sections that `selects` accepts."""
    inputs = [
        process.get("subscribes") for process in run.processes if selects(process.get("section"))
    ]
    return {
        str(end.get("topic"))
        for ends in inputs
        if isinstance(ends, list)
        for end in ends
        if isinstance(end, dict)
    }


def playable_topics(
    run: RecordedRun, named: Sequence[str], *, may_move: bool
) -> tuple[list[str], list[str]]:
    """The topics to publish, and those skipped because they command robots.

    Args:
        run: the recording.
        named: full names; empty: all topics with messages.
        may_move: whether commanding robots is allowed.

    Raises:
        CommandFailedError: a named topic commands a robot, or there is nothing to publish.
    """
    recorded = [one.topic for one in run.bag.topics if one.count]
    commands = frozenset[str]() if may_move else command_topics(run)
    if refused := [topic for topic in named if topic in commands]:
        raise CommandFailedError(
            f"refusing to publish on {list_names(refused)}: this would command a robot",
            help="to publish commands anyway, add `--allow-hardware`",
        )
    wanted = [topic for topic in recorded if not named or topic in named]
    chosen = [topic for topic in wanted if topic not in commands]
    if not chosen:
        raise CommandFailedError(f"{run.path} contains no messages to publish")
    return chosen, [topic for topic in wanted if topic in commands]


def play(
    run: RecordedRun,
    topics: Collection[str],
    target: "GraphTarget",
    *,
    speed: float,
    may_move: bool,
    wait_s: float,
    note: Callable[[str], None],
    sets_clock: bool = False,
) -> Played:
    """Publish the messages of the given topics in real time.

    Args:
        run: the recording.
        topics: full names.
        target: the ROS domain and its running stacks.
        speed: playback speed, relative to the recording.
        may_move: whether commanding robots is allowed.
        wait_s: limit for finding subscribers of each topic [s].
        note: called with what the user should know.
        sets_clock: whether to also publish the recorded time on `/clock`.

    Raises:
        CommandFailedError: a robot in the domain subscribes to a topic, a topic of its stack is
            live, or a type is missing.
    """
    from obk_cli.introspect.publishing import refuse_robot_commands
    from obk_cli.ros.participant import OBSERVER_NODE, open_participant
    from obk_cli.ros.publisher import ALLOWED_PUBLISHER, RosPublisher
    from obk_cli.ros.types import find_type

    types = {one.topic: one.msg_type for one in run.bag.topics if one.topic in topics}
    node = ALLOWED_PUBLISHER if may_move else OBSERVER_NODE
    with open_participant(target.environment, target.modules(topics), node) as participant:
        if not participant.settle(target.nodes, _QUIET_S, min(_SILENT_WAIT_S, wait_s)):
            note(f"waiting up to {wait_s:g} s for nodes")
            participant.settle(target.nodes, _QUIET_S, wait_s)

        own = f"/{node}_{os.getpid()}"

        def refuse_moving() -> None:
            for name in () if may_move else types:
                topic = participant.topic(name)
                refuse_robot_commands(topic, target, "--allow-hardware")
                refuse_live_topic(topic, target, participant.nodes(), own)

        refuse_moving()
        publishers = {
            topic: RosPublisher(
                participant, participant.topic(topic), find_type(msg_type), depth=_DEPTH
            )
            for topic, msg_type in types.items()
        }
        _wait_for_subscribers(participant, publishers, wait_s, note)
        ticker = _Ticker(participant, RecordedClock(run), speed) if sets_clock else None
        start, start_ns = time.monotonic(), time.time_ns()
        counts, first_ns = dict.fromkeys(types, 0), None
        checked_s = -_CHECK_S
        for due_s, message in paced(messages_in_order(run.path, topics), speed):
            if ticker is not None:
                ticker.tick_until(start + due_s, message)
            RosPublisher.until(start + due_s)
            if due_s > checked_s + _CHECK_S:  # a robot may appear at any time
                checked_s = due_s
                refuse_moving()
            publishers[message.topic].publish_bytes(message.data)
            first_ns = message.published_ns if first_ns is None else first_ns
            counts[message.topic] += 1
        for publisher in publishers.values():
            publisher.rest()
    seconds = time.monotonic() - start
    return Played(counts=counts, first_ns=first_ns or 0, start_ns=start_ns, seconds=seconds)


def refuse_live_topic(
    topic: TopicInfo, target: "GraphTarget", nodes: Collection[str], own: str
) -> None:
    """Reject a topic that another node publishes while a robot is running.

    Recorded messages among the live ones, such as an old estimate, would disturb the control loop.

    Args:
        topic: the topic.
        target: the ROS domain and its running stacks.
        nodes: full names of the nodes in the domain.
        own: full name of the node that replays.

    Raises:
        CommandFailedError: the topic has another publisher, and a robot is running.
    """
    planned = [node for plan in target.plans for node in plan.nodes]
    has_robot = any(node.section == "robot" for node in planned) or any(map(_is_robot, nodes))
    if topic.name in _LOGS or not has_robot:
        return
    names = [
        *(one.full_name for one in planned if any(e.topic == topic.name for e in one.publishes)),
        *(end.node or UNNAMED for end in topic.publishers if end.node != own),
    ]
    if names:
        raise CommandFailedError(
            f"{topic.name} is published by {list_names([*dict.fromkeys(names)])}, and a robot is "
            f"running in the ROS domain {target.domain}",
            help="stop the stack, select other topics with `--topic`, or another domain with "
            "`--domain`; to publish anyway, add `--allow-hardware`",
        )


class _Ticker:
    """Publishes the recorded time on `/clock`, at least once per millisecond."""

    def __init__(self, participant: "RosParticipant", clock: RecordedClock, speed: float) -> None:
        from obk_cli.ros.publisher import RosPublisher
        from obk_cli.ros.simulated_clock import CLOCK_TYPE
        from obk_cli.ros.types import find_type

        topic = participant.topic(CLOCK_TOPIC)
        self._publisher = RosPublisher(participant, topic, find_type(CLOCK_TYPE))
        self._clock = clock
        self._speed = speed
        self._last_ns = 0
        self._last_s = time.monotonic()

    def tick_until(self, due_s: float, message: RecordedMessage) -> None:
        """Advance to the time of a message; `due_s` is when it is due on the monotonic clock."""
        goal_ns = max(self._clock.time_ns(message.published_ns), self._last_ns)
        while self._last_ns and (now_s := time.monotonic()) < due_s - _TICK_S:
            passed_ns = round((now_s - self._last_s) * self._speed * _NS_PER_S)
            self._publish(min(goal_ns, self._last_ns + passed_ns))
            time.sleep(_TICK_S)
        self._publish(goal_ns)
        self._last_ns, self._last_s = goal_ns, due_s

    def _publish(self, time_ns: int) -> None:
        stamp = struct.pack("<iI", *divmod(time_ns, _NS_PER_S))
        self._publisher.publish_bytes(b"\0\1\0\0" + stamp)


def paced(
    messages: Iterable[RecordedMessage], speed: float
) -> Iterator[tuple[float, RecordedMessage]]:
    """Yield each message with the time at which it is due, measured from the first message [s]."""
    first: int | None = None
    for message in messages:
        first = message.published_ns if first is None else first
        yield max(0.0, (message.published_ns - first) * 1e-9 / speed), message


def _wait_for_subscribers(
    participant: "RosParticipant",
    publishers: "Mapping[str, RosPublisher]",
    wait_s: float,
    note: Callable[[str], None],
) -> None:
    """Wait until a subscription exists and all known ones are matched; continue after the limit."""

    def is_ready() -> bool | None:
        matched = {topic: one.subscribers for topic, one in publishers.items()}
        known = all(
            count >= len(participant.topic(topic).subscriptions) for topic, count in matched.items()
        )
        return True if known and any(matched.values()) else None

    if not participant.wait_for(is_ready, wait_s if participant.nodes() else 0.0):
        has_some = any(participant.topic(topic).subscriptions for topic in publishers)
        why = "not all subscribers are connected" if has_some else "no node subscribes"
        note(f"{why}; publishing anyway")
