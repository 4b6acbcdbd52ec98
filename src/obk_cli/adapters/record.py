"""One recording from its begin to its end, in the process that calls it.

Run as a program, `python -m obk_cli.adapters.record JOB`, it does what a job file says: the form in
which a launch has it beside its nodes. Ends on SIGINT, SIGTERM, SIGHUP, or when its time is over.
"""

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from obk_cli.adapters.bag_writer import BagWriter
from obk_cli.adapters.ros_recorder import RosRecorder
from obk_cli.errors import EXIT_DONE, EXIT_MISUSE, CommandFailedError
from obk_cli.files import explain_os_error
from obk_cli.optional_deps import no_ros
from obk_cli.process.shared_memory_check import require_shared_memory
from obk_cli.process.signals import end_signals_heard
from obk_cli.recording.job import BEGUN, Job, job_from_json
from obk_cli.recording.tally import DROPS, Tally

__all__ = ["Recorded", "main", "record", "recorded_text"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """How a recording ended."""

    path: Path
    seconds: float
    tallies: Mapping[str, Tally]
    """By topic."""


def record(job: Job, tell: Callable[[str], None]) -> Recorded:
    """Record until a signal comes or the time is over; only from the main thread.

    Args:
        job: what.
        tell: takes sentences for the user, the first one once the recording has begun.

    Raises:
        CommandFailedError: the file is there already or takes no more, or ROS does not start.
    """
    with ExitStack() as stack:
        is_over = threading.Event()
        stack.enter_context(end_signals_heard(lambda _: is_over.set()))
        node = stack.enter_context(_node())
        writer = BagWriter(job.path)
        try:
            with writer:
                writer.describe(job.metadata, job.attachments, time.time_ns())
                recorder = RosRecorder(node, writer, job.wish, tell)
                begin = time.monotonic()
                end = float("inf") if job.duration_s is None else begin + job.duration_s
                tell(f"{BEGUN}{job.path}")
                while not is_over.is_set() and time.monotonic() < end:
                    recorder.turn()
                recorder.finish()
                drops = {name: str(t.dropped) for name, t in recorder.tallies.items()}
                writer.describe({DROPS: drops}, {}, time.time_ns())
        except OSError as error:
            raise CommandFailedError(
                f"{job.path}: {explain_os_error(error)}: the recording ends here; what was "
                "written before can be read"
            ) from error
        seconds = time.monotonic() - begin
        return Recorded(path=job.path, seconds=seconds, tallies=recorder.tallies)


def recorded_text(recorded: Recorded) -> str:
    """The end of a recording in a sentence."""
    tallies = recorded.tallies.values()
    topics = sum(1 for tally in tallies if tally.count)
    return (
        f"recorded {sum(t.count for t in tallies)} messages of {topics} topics in "
        f"{recorded.seconds:.1f} s, {sum(t.dropped for t in tallies)} lost: {recorded.path}"
    )


@contextmanager
def _node() -> Iterator[Any]:
    """A ROS node in the domain of the environment.

    Raises:
        CommandFailedError: there is no rclpy, or it does not start.
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
            stack.callback(node.destroy_node)
        except Exception as error:
            raise CommandFailedError(f"ROS 2 does not start: {error}") from error
        yield node


def main(arguments: list[str]) -> int:
    """Do what a job file says; gives the exit code."""
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
