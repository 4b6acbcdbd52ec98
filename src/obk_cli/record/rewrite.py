"""Copy topics of a recording into another one, with other times."""

from collections.abc import Callable, Collection, Mapping
from pathlib import Path

from obelisk_recordings.chunks import messages_in_order
from obelisk_recordings.run import RecordedRun
from obk_cli.files import whole_file
from obk_cli.record.mcap_writer import BagWriter

__all__ = ["rewrite"]


def rewrite(
    run: RecordedRun,
    path: Path,
    topics: Collection[str],
    time_ns: Callable[[int], int],
    metadata: Mapping[str, Mapping[str, str]],
) -> None:
    """Write a recording; replaces the file, unless an error occurs.

    Args:
        run: the source, copied with its attachments.
        path: the new file.
        topics: full names of the topics to copy.
        time_ns: maps a time in the run to a new time [ns since 1970].
        metadata: metadata of the new file; replaces the run's own of the same name.

    Raises:
        CommandFailedError: the file cannot be written.
        RecordingError: the run cannot be read.
    """
    definitions = {part.name: part.messages.definition for part in run.parts(topics)}
    types = {one.topic: one.msg_type for one in run.bag.topics if one.topic in topics}
    with whole_file(path) as temporary, BagWriter(temporary) as writer:
        writer.describe({**run.metadata, **metadata}, run.attachments, 0)
        channels = {
            name: writer.add_topic(name, kind, definitions.get(name, ""), {})
            for name, kind in types.items()
        }
        for one in messages_in_order(run.path, topics):
            times = time_ns(one.received_ns), time_ns(one.published_ns)
            writer.add_message(channels[one.topic], one.data, *times, one.sequence)
