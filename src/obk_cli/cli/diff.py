"""`obk diff RUN1 RUN2`: what differs between two recorded runs."""

import os
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

from obelisk_recordings.find import find_recording
from obelisk_spec.suggestions import list_names, with_number
from obk_cli.cli.options import (
    FormatOption,
    RunArgument,
    note_if_incomplete,
    print_json,
    wants_json,
)
from obk_cli.errors import CommandFailedError
from obk_cli.runs.folder import runs_folder
from obk_cli.terminal import columns_of, escaped, shortened

if TYPE_CHECKING:
    from obk_cli.record.compare import RunComparison

__all__ = ["EXAMPLE", "command", "difference_lines", "signal_lines"]

EXAMPLE = """\b
Example: obk diff dummy_20260301_120000 dummy_20260301_121500
         obk diff before.mcap after.mcap --format json
"""
_WIDEST = 32
"""Width of a value in the table [columns]."""
_Row = tuple[str, str, str, str, str, str]


def command(
    first: RunArgument,
    second: RunArgument,
    format: FormatOption = "text",
) -> None:
    """Compare two recorded runs.

    The command shows differences in config, versions, code, message definitions and parameters. It
    then compares the rate and jitter of each topic, rejected commands, and each numeric field.
    Jitter is the p99 deviation of intervals from their mean. For each numeric field, the command
    shows the RMS difference and the largest difference since the stack became active. The second
    run is interpolated at the times of the first. A number that only one run has, because the other
    one has NaN or a shorter array, is a difference. For fields that do not differ, only their count
    is shown. An array of more than 32 numbers is one field; if it consists of bytes, such as an
    image, the command only shows whether all messages are equal. Text and /rosout are not compared.
    """
    is_json = wants_json(format)

    from obk_cli.optional_deps import require_extra

    require_extra("mcap", "record")

    from obelisk_recordings.run import open_run
    from obk_cli.record.compare import compare_runs

    parent = runs_folder(os.environ)
    runs = [open_run(find_recording(parent, name)) for name in (first, second)]
    for run in runs:
        note_if_incomplete(run)
    found = compare_runs(runs[0], runs[1])
    empty = [run.name for run in runs if not run.bag.count]
    if is_json:
        print_json(asdict(found))
    elif not empty:
        print("\n".join([*_table([_head(found), *_rows(found)]), *_summary(found)]))
    if empty:
        raise CommandFailedError(f"nothing to compare: no messages in {list_names(empty)}")


def difference_lines(found: "RunComparison") -> Iterator[str]:
    """Lines of the table of topics and numbers only."""
    yield from _table([_head(found), *_topic_rows(found), *_signal_rows(found)])


def signal_lines(found: "RunComparison") -> Iterator[str]:
    """Lines of the table of numbers only."""
    yield from _table([_head(found), *_signal_rows(found)])


def _head(found: "RunComparison") -> _Row:
    return ("", found.runs[0], found.runs[1], "rms", "max", "at [s]")


def _rows(found: "RunComparison") -> Iterator[_Row]:
    for group in ("versions", "config", "parameters"):
        for one in getattr(found, group):
            yield (f"{group}: {one.what}", _value(one.first), _value(one.second), "", "", "")
    yield from _topic_rows(found)
    rejected = found.rejected_commands
    if any(rejected):
        yield ("rejected commands", _value(rejected[0]), _value(rejected[1]), "", "", "")
    yield from _signal_rows(found)


def _topic_rows(found: "RunComparison") -> Iterator[_Row]:
    for topic in found.topics:
        name, types, counts = topic.topic, topic.msg_type, topic.count
        if types[0] != types[1]:
            yield (f"{name} type", _value(types[0]), _value(types[1]), "", "", "")
        elif not topic.same_definition:
            yield (f"{name} definition", "differs", "differs", "", "", "")
        yield (f"{name} messages", str(counts[0]), str(counts[1]), "", "", "")
        rates, jitter = topic.rate_hz, topic.jitter_p99_ms
        yield (f"{name} rate [Hz]", f"{rates[0]:.1f}", f"{rates[1]:.1f}", "", "", "")
        yield (f"{name} jitter p99 [ms]", f"{jitter[0]:.2f}", f"{jitter[1]:.2f}", "", "", "")


def _signal_rows(found: "RunComparison") -> Iterator[_Row]:
    for signal in found.signals:
        if signal.differs:
            unit = f" [{signal.unit}]" if signal.unit else ""
            missing = [f"{count}x missing" if count else "" for count in signal.missing]
            yield (
                f"{signal.topic}.{signal.signal}{unit}",
                missing[0],
                missing[1],
                f"{signal.rms:.4g}",
                f"{signal.largest:.4g}",
                f"{signal.at_s:.3f}",
            )

    for one in found.byte_arrays:
        if not one.is_same:
            yield (f"{one.topic}.{one.field}", "differs", "differs", "", "", "")


def _value(value: object) -> str:
    if value is None or value == "":
        return "-"
    return shortened(escaped(str(value)), _WIDEST)


def _table(rows: list[_Row]) -> Iterator[str]:
    """The rows with aligned columns; numbers are right-aligned."""
    cells = [tuple(map(escaped, row)) for row in rows]
    widths = [max(columns_of(row[place]) for row in cells) for place in range(6)]
    for row in cells:
        line = []
        for place, cell in enumerate(row):
            space = " " * (widths[place] - columns_of(cell))
            line.append(cell + space if place < 3 else space + cell)
        yield "  ".join(line).rstrip()


def _summary(found: "RunComparison") -> Iterator[str]:
    differing = sum(1 for one in found.signals if one.differs)
    differing += sum(1 for one in found.byte_arrays if not one.is_same)
    count = len(found.signals) + len(found.byte_arrays)
    if not count:
        yield "no numbers were compared"
    elif found.is_same:
        yield f"no number differs except times: {with_number(count, 'signal')} compared"
    else:
        yield f"{differing} of {with_number(count, 'signal')} differ"
    for topic in found.without_numbers:
        yield f"note: {topic} is not compared, because it contains no numbers"
    if None in found.rejected_commands:
        yield (
            "note: rejected commands are counted only for recordings that are still in their run's "
            "folder"
        )
