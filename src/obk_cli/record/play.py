"""Publish recorded messages again, at the pace of their publication."""

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from obelisk_recordings.chunks import RecordedMessage, messages_in_order
from obelisk_recordings.run import RecordedRun
from obelisk_spec.suggestions import list_names
from obk_cli.errors import CommandFailedError

if TYPE_CHECKING:
    from obk_cli.introspect.target import GraphTarget
    from obk_cli.ros.participant import RosParticipant
    from obk_cli.ros.publisher import RosPublisher

__all__ = ["Played", "command_topics", "inputs_of", "play", "playable_topics"]

_DEPTH: Final = 1000
"""Messages that wait for a slow subscription: a second of a fast topic."""
_CHECK_S: Final = 1.0
"""Between two looks for robots that subscribe [s, at the pace of the recording]."""
_COMMANDS: Final = "obelisk_control_msgs/"
"""Messages of this package command robots, whatever the topic is called."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Played:
    """What was published."""

    counts: dict[str, int]
    """Topic -> messages."""
    seconds: float
    """How long it took [s]."""


def command_topics(run: RecordedRun) -> frozenset[str]:
    """The recorded topics that command a robot: by the run's config, or by the type."""
    planned = inputs_of(run, lambda section: section == "robot")
    typed = {one.topic for one in run.bag.topics if one.msg_type.startswith(_COMMANDS)}
    return frozenset(planned & set(run.topics) | typed)


def inputs_of(run: RecordedRun, is_wanted: Callable[[object], bool]) -> set[str]:
    """The topics that nodes of some sections of the recorded config subscribe to."""
    processes = run.plan.get("processes")
    return {
        str(end.get("topic"))
        for process in (processes if isinstance(processes, list) else ())
        if isinstance(process, dict) and is_wanted(process.get("section"))
        for end in process.get("subscribes") or ()
        if isinstance(end, dict)
    }


def playable_topics(
    run: RecordedRun, named: Sequence[str], *, may_move: bool
) -> tuple[list[str], list[str]]:
    """The topics to publish, and those that are left out because they command robots.

    Args:
        run: the recording.
        named: full names; empty: all that have messages.
        may_move: whether robots may be commanded.

    Raises:
        CommandFailedError: a named topic commands a robot, or there is nothing to publish.
    """
    recorded = [one.topic for one in run.bag.topics if one.count]
    commands = frozenset[str]() if may_move else command_topics(run)
    if refused := [topic for topic in named if topic in commands]:
        raise CommandFailedError(
            f"refusing to publish on {list_names(refused)}, which commands a robot",
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
) -> Played:
    """Publish the messages of some topics in real time.

    Args:
        run: the recording.
        topics: full names.
        target: the ROS domain, and the stacks that run in it.
        speed: how many times faster than they were recorded.
        may_move: whether robots may be commanded.
        wait_s: how long to wait for subscribers of each topic [s].

    Raises:
        CommandFailedError: a robot in the domain subscribes to a topic, or a type is not here.
    """
    from obk_cli.introspect.publishing import refuse_robot_commands
    from obk_cli.ros.participant import OBSERVER_NODE, open_participant
    from obk_cli.ros.publisher import ALLOWED_PUBLISHER, RosPublisher
    from obk_cli.ros.types import find_type

    types = {one.topic: one.msg_type for one in run.bag.topics if one.topic in topics}
    node = ALLOWED_PUBLISHER if may_move else OBSERVER_NODE
    with open_participant(target.environment, target.modules(topics), node) as participant:
        participant.settle(target.nodes, 0.5, wait_s)

        def refuse_robots() -> None:
            for topic in () if may_move else types:
                refuse_robot_commands(participant.topic(topic), target)

        refuse_robots()
        publishers = {
            topic: RosPublisher(
                participant, participant.topic(topic), find_type(msg_type), depth=_DEPTH
            )
            for topic, msg_type in types.items()
        }
        _wait_for_subscribers(participant, publishers, wait_s)
        begin, counts = time.monotonic(), dict.fromkeys(types, 0)
        checked_s = -_CHECK_S
        for due_s, message in paced(messages_in_order(run.path, topics), speed):
            RosPublisher.until(begin + due_s)
            if due_s > checked_s + _CHECK_S:  # a robot may come at any time
                checked_s = due_s
                refuse_robots()
            publishers[message.topic].publish_bytes(message.data)
            counts[message.topic] += 1
        for publisher in publishers.values():
            publisher.rest()
    return Played(counts=counts, seconds=time.monotonic() - begin)


def paced(
    messages: Iterable[RecordedMessage], speed: float
) -> Iterator[tuple[float, RecordedMessage]]:
    """Messages with the time after the first one at which each is due [s]."""
    first: int | None = None
    for message in messages:
        first = message.published_ns if first is None else first
        yield max(0.0, (message.published_ns - first) * 1e-9 / speed), message


def _wait_for_subscribers(
    participant: "RosParticipant", publishers: "Mapping[str, RosPublisher]", wait_s: float
) -> None:
    """Wait until there is a subscription and all that are known are matched; then go on anyway."""

    def is_ready() -> bool | None:
        matched = {topic: one.subscribers for topic, one in publishers.items()}
        known = all(
            count >= len(participant.topic(topic).subscriptions) for topic, count in matched.items()
        )
        return True if known and any(matched.values()) else None

    participant.wait_for(is_ready, wait_s)
