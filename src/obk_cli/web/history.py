"""Read fields over a whole run from its recording, for the page's plots."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from obelisk_recordings.bag import RecordingError
from obelisk_recordings.find import RECORDING
from obk_cli.errors import CommandFailedError
from obk_cli.monitor.model import StackView
from obk_cli.optional_deps import require_extra
from obk_cli.web.plots import MOST_LINES, FieldRequest

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from obelisk_recordings.topic import RecordedTopic

    Floats = NDArray[np.float64]

__all__ = ["recorded_fields"]

MOST_POINTS: Final = 8_000
"""Maximum number of points of a line; a longer line is reduced to the extremes of intervals."""


@dataclass(slots=True)
class _Line:
    """One line of a plot while the recording is read."""

    times_s: "list[Floats]" = field(default_factory=list)
    values: "list[Floats]" = field(default_factory=list)


def recorded_fields(
    view: StackView, runs: Path, requests: Sequence[FieldRequest]
) -> list[dict[str, Any]]:
    """The fields in the page's format: `curve`, `fault` and, for each number, `lines`.

    A line has the same label as in the live plots, and times of receipt [s since 1970] and values
    as base64 of 64-bit floats.

    Args:
        view: the stack.
        runs: the folder of all runs.
        requests: the fields; a problem with a field is reported as its fault.

    Raises:
        CommandFailedError: the run has no recording on this host, it cannot be read, or the
            `record` extra is not installed.
    """
    path = runs / view.run / RECORDING
    if not view.run or not path.is_file():
        raise CommandFailedError(
            f"{view.run or 'this stack'} has no recording on this host, so only the last seconds "
            "are available",
            help="launch with `obk launch --record` to see the whole run",
        )
    require_extra("mcap", "record")

    try:
        return [*_read(path, requests)]
    except RecordingError as error:
        raise CommandFailedError(error.message, help=error.help) from error


def _read(path: Path, requests: Sequence[FieldRequest]) -> Iterator[dict[str, Any]]:
    from obelisk_recordings.chunks import messages_in_parts
    from obelisk_recordings.topic import RecordedTopic
    from obk_cli.record.plot import packed_line

    found: dict[FieldRequest, dict[str, _Line]] = {request: {} for request in requests}
    faults: dict[FieldRequest, str] = {}
    # Not with `open_run`: it counts all messages of a file that is still being written.
    for messages in messages_in_parts(path, {request.topic for request in requests}):
        part = RecordedTopic(messages)
        for request, lines in found.items():
            if request.topic == part.name and request not in faults:
                try:
                    _add(part, request.field, lines)
                except RecordingError as error:
                    faults[request] = str(error)
    for request, lines in found.items():
        fault = faults.get(request, "" if lines else "the recording has no messages of this topic")
        packed = [
            {"label": label, **packed_line(line.times_s, line.values, MOST_POINTS)}
            for label, line in lines.items()
        ]
        yield {"curve": f"{request.topic} {request.field}", "fault": fault, "lines": packed}


def _add(part: "RecordedTopic", field_path: str, lines: dict[str, _Line]) -> None:
    for signal in islice(part.signals(field_path), MOST_LINES):
        place = "" if signal.place is None else f"[{signal.place}]"
        line = lines.setdefault(f"{signal.path}{place}", _Line())
        line.times_s.append(part.messages.received_ns / 1_000_000_000)
        line.values.append(signal.values())
