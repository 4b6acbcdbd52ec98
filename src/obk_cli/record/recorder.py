"""Record topics of a ROS graph: serialized messages go straight from subscriptions into a file.

No message is deserialized and no executor is used: every few milliseconds, the recorder takes the
waiting messages of each subscription. The recorder subscribes to a topic as soon as it knows the
type, which may be before the topic has a publisher. It never blocks a publisher: messages
that arrive too fast are dropped and counted.

As a program, `python -m obk_cli.record.recorder JOB`, it runs a job file; a launch starts it
alongside its nodes. It stops on SIGINT, SIGTERM, SIGHUP, or after its duration.
"""

import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from obelisk_recordings.bag import DROPS
from obelisk_spec.suggestions import with_number
from obk_cli.errors import EXIT_DONE, EXIT_MISUSE, CommandFailedError
from obk_cli.files import explain_os_error
from obk_cli.optional_deps import no_ros
from obk_cli.process.shared_memory import require_shared_memory
from obk_cli.process.signals import handle_end_signals
from obk_cli.record.mcap_writer import FLUSH_S, BagWriter, offers_text
from obk_cli.record.recorder_job import (
    BEGUN,
    RecorderJob,
    RecordRequest,
    clashing_topics,
    job_from_json,
    matching_topics,
    unmatched_requests,
)
from obk_cli.ros.participant import remove_participant
from obk_cli.ros.raw_subscription import DropCounter, RawSubscription
from obk_cli.ros.types import find_type
from obk_cli.workspace.overlay import underlays_of

__all__ = ["RosRecorder", "installed_definition", "record", "recorded_text", "schema_text"]

FindDefinition = Callable[[str, str], str | None]
"""Package and message -> the text of its `.msg` file; None if it does not exist."""

_BAR = "=" * 80
# Message types start with a capital letter, primitive types with a lowercase one.
_OWN_TYPE = re.compile(r"\s*(?:(?P<package>[a-z]\w*)/)?(?P<name>[A-Z]\w*)\s*(?:\[[^\]]*\])?\s+\w")


def schema_text(msg_type: str, find: FindDefinition) -> str | None:
    """The definition of `pkg/msg/Name` and of all types that it refers to; None if one is missing.

    Args:
        msg_type: full name.
        find: looks up a definition.
    """
    package, _, name = msg_type.split("/")
    texts: dict[str, str] = {}
    waiting = [(package, name)]
    while waiting:
        package, name = waiting.pop(0)
        if f"{package}/{name}" in texts:
            continue
        text = find(package, name)
        if text is None:
            return None
        texts[f"{package}/{name}"] = text.strip("\n")
        waiting.extend(_parts(text, package))
    first, *others = texts.items()
    return "\n".join([first[1], *(f"{_BAR}\nMSG: {name}\n{text}" for name, text in others)]) + "\n"


def _parts(text: str, package: str) -> Iterator[tuple[str, str]]:
    """Package and name of the message types of a definition's fields."""
    for line in text.splitlines():
        field = _OWN_TYPE.match(line.partition("#")[0])
        if field is not None:
            yield field["package"] or package, field["name"]


def installed_definition(package: str, name: str) -> str | None:
    """The definition of a message from the first prefix that has it; None if none does."""
    for prefix in underlays_of(os.environ, ()):
        path = Path(prefix, "share", package, "msg", f"{name}.msg")
        if path.is_file():
            return path.read_text(encoding="utf-8", errors="replace")
    return None


POLL_S: Final = 0.005
"""Interval between two polls of the subscriptions [s]."""
GRAPH_POLL_S: Final = 0.1
"""Interval between two polls of the ROS graph [s]."""
REPORT_S: Final = 5.0
"""Interval between two reports of dropped messages [s]."""


@dataclass(slots=True, kw_only=True)
class _Topic:
    """One topic that is recorded."""

    raw: RawSubscription
    counter: DropCounter = field(default_factory=DropCounter)
    channel: int | None = None


class RosRecorder:
    """Subscribes and writes in the thread that calls `turn`."""

    def __init__(
        self, node: Any, writer: BagWriter, request: RecordRequest, report: Callable[[str], None]
    ) -> None:
        """Subscribe to the topics that are already known.

        Args:
            node: the rclpy node; it is not spun.
            writer: receives the messages.
            request: the topics to record.
            report: receives sentences for the user.
        """
        self._node = node
        self._writer = writer
        self._request = request
        self._report = report
        self._topics: dict[str, _Topic] = {}
        self._rejected: set[str] = set()
        self._clashing: set[str] = set()
        self._flushed = self._polled = self._reported = time.monotonic()
        self._reported_drops = 0
        self.poll_graph()

    @property
    def counters(self) -> Mapping[str, DropCounter]:
        """Recorded and dropped messages by topic."""
        return {name: topic.counter for name, topic in self._topics.items()}

    @property
    def dropped(self) -> int:
        """Number of messages dropped, over all topics."""
        return sum(topic.counter.dropped for topic in self._topics.values())

    def turn(self) -> None:
        """Write waiting messages, and poll the graph if due; takes a few milliseconds.

        Raises:
            OSError: the file cannot be written.
        """
        start = time.monotonic()
        self.take()
        if start - self._flushed > FLUSH_S:
            self._writer.flush()
            self._flushed = start
        if start - self._polled > GRAPH_POLL_S:
            self._polled = start
            self.poll_graph()
        if start - self._reported > REPORT_S:
            self._reported = start
            self._report_drops()
        time.sleep(max(0.0, POLL_S - (time.monotonic() - start)))

    def take(self) -> None:
        """Write the waiting messages.

        Raises:
            OSError: the file cannot be written.
        """
        for topic in self._topics.values():
            self._write(topic, topic.raw.take())

    def poll_graph(self) -> None:
        """Subscribe to new topics, and resubscribe if a new publisher's QoS requires it."""
        graph = dict(self._node.get_topic_names_and_types())
        for name, msg_type in matching_topics(self._request, graph).items():
            if name not in self._topics and name not in self._rejected:
                self._begin(name, msg_type)
        for name, kinds in clashing_topics(self._request, graph).items():
            if name not in self._topics and name not in self._clashing:
                self._clashing.add(name)
                types = " and ".join(kinds)
                self._report(f"warning: {name} is not recorded while it has the types {types}")
        for topic in self._topics.values():
            topic.raw.refresh()

    def finish(self) -> None:
        """Write the remaining messages; topics without a message are recorded as well.

        Raises:
            OSError: the file cannot be written.
        """
        for topic in self._topics.values():
            self._write(topic, topic.raw.take_last())
            if topic.channel is None:
                self._channel(topic)
        for sentence in unmatched_requests(
            self._request, {*self._topics, *self._rejected, *self._clashing}
        ):
            self._report(f"warning: not recorded: {sentence}")
        self._report_drops()

    def close(self) -> None:
        """Unsubscribe from all topics."""
        for topic in self._topics.values():
            topic.raw.close()

    def _begin(self, name: str, msg_type: str) -> None:
        try:
            raw = RawSubscription(self._node.handle, name, msg_type, find_type(msg_type))
        except Exception as error:  # generated packages may raise anything
            self._rejected.add(name)
            self._report(f"warning: {name} is not recorded: {error}")
            return
        self._topics[name] = _Topic(raw=raw)

    def _write(self, topic: _Topic, messages: Iterator[tuple[bytes, Mapping[str, int]]]) -> None:
        counter, publishers = topic.counter, topic.raw.publishers
        for data, info in messages:
            sequence = info["publication_sequence_number"]
            counter.take(sequence, publishers)
            self._writer.add_message(
                self._channel(topic) if topic.channel is None else topic.channel,
                data,
                info["received_timestamp"],
                info["source_timestamp"],
                sequence,
            )

    def _channel(self, topic: _Topic) -> int:
        raw = topic.raw
        raw.learn()
        definition = schema_text(raw.msg_type, installed_definition)
        if definition is None:
            self._report(f"warning: {raw.name}: the definition of {raw.msg_type} was not found")
        topic.channel = self._writer.add_topic(
            raw.name,
            raw.msg_type,
            definition or "",
            {
                "offered_qos_profiles": offers_text(raw.offers),
                "topic_type_hash": min(raw.hashes, default=""),
            },
        )
        return topic.channel

    def _report_drops(self) -> None:
        if self.dropped > self._reported_drops:
            self._reported_drops = self.dropped
            names = [name for name, topic in self._topics.items() if topic.counter.dropped]
            self._report(
                f"warning: {with_number(self.dropped, 'message')} lost so far, "
                f"from {', '.join(names)}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """The result of a recording."""

    path: Path
    seconds: float
    counters: Mapping[str, DropCounter]
    """By topic."""


def record(job: RecorderJob, report: Callable[[str], None]) -> Recorded:
    """Record until a signal arrives or the duration has elapsed; to be called on the main thread.

    Args:
        job: what to record.
        report: receives sentences for the user, the first when the recording has started.

    Raises:
        CommandFailedError: the file already exists or cannot be written, or ROS does not start.
    """

    def tell(sentence: str) -> None:
        with suppress(BrokenPipeError):  # the output was closed; the recording continues
            report(sentence)

    with ExitStack() as stack:
        is_over = threading.Event()
        stack.enter_context(handle_end_signals(lambda _: is_over.set()))
        node = stack.enter_context(_node())
        writer = BagWriter(job.path)
        try:
            with writer:
                writer.describe(job.metadata, job.attachments, time.time_ns())
                recorder = RosRecorder(node, writer, job.request, tell)
                stack.callback(recorder.close)
                start = time.monotonic()
                end = float("inf") if job.duration_s is None else start + job.duration_s
                tell(f"{BEGUN}{job.path}")
                while not is_over.is_set() and time.monotonic() < end:
                    recorder.turn()
                recorder.finish()
                drops = {name: str(one.dropped) for name, one in recorder.counters.items()}
                writer.describe({DROPS: drops}, {}, time.time_ns())
        except OSError as error:
            raise CommandFailedError(
                f"{job.path}: {explain_os_error(error)}: the recording ends here; everything "
                "written before is readable"
            ) from error
        seconds = time.monotonic() - start
        return Recorded(path=job.path, seconds=seconds, counters=recorder.counters)


def recorded_text(recorded: Recorded) -> str:
    """The result of a recording as a sentence."""
    counters = recorded.counters.values()
    topics = sum(1 for counter in counters if counter.count)
    return (
        f"recorded {with_number(sum(one.count for one in counters), 'message')} "
        f"from {with_number(topics, 'topic')} in "
        f"{recorded.seconds:.1f} s, {sum(one.dropped for one in counters)} lost: {recorded.path}"
    )


@contextmanager
def _node() -> Iterator[Any]:
    """A ROS node in the domain of the environment.

    Raises:
        CommandFailedError: rclpy is missing or does not start.
    """
    require_shared_memory()
    try:
        import rclpy
        from rclpy.signals import SignalHandlerOptions
    except ImportError as error:
        raise no_ros(error) from error
    with ExitStack() as stack:
        context = rclpy.Context()
        try:
            rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
            stack.callback(context.try_shutdown)
            node: Any = rclpy.create_node(
                f"obk_record_{os.getpid()}",
                context=context,
                enable_rosout=False,
                start_parameter_services=False,
            )
            stack.callback(remove_participant, node.destroy_node)
        except Exception as error:
            raise CommandFailedError(f"ROS 2 does not start: {error}") from error
        yield node


def main(arguments: list[str]) -> int:
    """Run a job file; return the exit code."""
    if len(arguments) != 1:
        return EXIT_MISUSE
    job = job_from_json(Path(arguments[0]).read_text(encoding="utf-8"))
    try:
        print(recorded_text(record(job, lambda text: print(text, flush=True))), flush=True)
    except CommandFailedError as error:
        print(error.message, flush=True)
        return error.exit_code
    return EXIT_DONE


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
