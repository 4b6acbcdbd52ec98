"""Compare two recorded runs: their origin, their topics, and each number over time.

Times are since the activation of the stack. Each run is read once and in parts, so two recordings
of any length need little memory.
"""

import hashlib
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from obelisk_recordings.chunks import messages_in_order
from obelisk_recordings.layout import PRIMITIVES
from obelisk_recordings.run import RecordedRun
from obelisk_recordings.topic import RecordedTopic
from obelisk_spec.suggestions import with_number
from obk_cli.runs.logs import LAUNCH_LOG

__all__ = [
    "FirstDifference",
    "RunComparison",
    "SignalDifference",
    "compare_runs",
    "first_different_message",
]

Floats = NDArray[np.float64]
_STAMP: Final = re.compile(r"(?:^|\.)(?:sec|nanosec)$")
"""Time fields, which differ between any two runs."""
_ROUNDING: Final = 1e-9
"""Tolerance for a constant number."""
_REJECTED: Final = re.compile(r"control rejected: .*?; (\d+) in total")
"""Log message of a robot, at most once per second."""
_ROSOUT: Final = "/rosout"
_MOST_NUMBERS: Final = 32
"""Maximum length of an array whose numbers are signals of their own; a longer one is one signal."""
_BYTE: Final = PRIMITIVES["uint8"]
_Key = tuple[str, int | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """A value that differs between the runs."""

    what: str
    first: Any
    """In the first run; None if it does not exist there."""
    second: Any


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicComparison:
    """A topic with messages in at least one run; each pair has a value per run."""

    topic: str
    msg_type: tuple[str, str]
    """Empty if the run has no message of the topic."""
    same_definition: bool
    count: tuple[int, int]
    rate_hz: tuple[float, float]
    """From the first message to the last."""
    jitter_p99_ms: tuple[float, float]
    """p99 of the intervals' deviations from their mean, as in `obk topic hz` [ms]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalDifference:
    """One number in both runs, at the times of the first; the second is interpolated.

    All numbers of a long array count as one.
    """

    topic: str
    signal: str
    unit: str
    rms: float
    largest: float
    at_s: float
    """When the difference is largest [s since activation]."""
    count: int
    """Number of compared values."""
    missing: tuple[int, int]
    """Number of values that only this run lacks, because of NaN or a shorter array."""
    span: float
    """Maximum minus minimum in the first run, at these times."""

    @property
    def differs(self) -> bool:
        """Whether a number differs or is missing in one run."""
        return self.largest != 0.0 or any(self.missing)

    def is_within(self, tolerance: float) -> bool:
        """Whether the RMS is at most this fraction of the span; likewise for missing numbers."""
        missing = sum(self.missing)
        is_close = self.rms <= tolerance * self.span + _ROUNDING
        return is_close and missing <= tolerance * (self.count + missing)


@dataclass(frozen=True, slots=True, kw_only=True)
class BytesComparison:
    """A long array of bytes, such as the pixels of an image."""

    topic: str
    field: str
    is_same: bool
    """Whether the bytes are equal in all messages, in order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunComparison:
    """All results of a comparison."""

    runs: tuple[str, str]
    versions: tuple[Difference, ...]
    config: tuple[Difference, ...]
    parameters: tuple[Difference, ...]
    topics: tuple[TopicComparison, ...]
    signals: tuple[SignalDifference, ...]
    byte_arrays: tuple[BytesComparison, ...]
    without_numbers: tuple[str, ...]
    """Topics with text only, which is not compared."""
    rejected_commands: tuple[int | None, int | None]
    """As logged by the robots, at most once per second; None if there is no log."""

    @property
    def is_same(self) -> bool:
        """Whether nothing differs except rates and times."""
        same_topics = all(one.same_definition and all(one.msg_type) for one in self.topics)
        counts = {one.topic: one.count for one in self.topics}
        # Bytes are not interpolated, so a run with one message more has other bytes.
        differs = any(one.differs for one in self.signals) or any(
            not one.is_same and len({*counts[one.topic]}) == 1 for one in self.byte_arrays
        )
        return not (self.versions or self.config or self.parameters or differs) and same_topics


def compare_runs(
    first: RecordedRun, second: RecordedRun, only: Collection[str] | None = None
) -> RunComparison:
    """Compare two runs.

    Args:
        first: the first run.
        second: the second run.
        only: topics to compare; None: all except the log.

    Raises:
        RecordingError: a recording cannot be read.
    """
    runs = (first, second)
    topics = _compare_topics(runs, only)
    config, parameters = _compare_plans(first.plan, second.plan)
    return RunComparison(
        runs=(first.name, second.name),
        versions=tuple(_versions(runs)),
        config=config,
        parameters=parameters,
        topics=tuple(one.comparison() for one in topics),
        signals=tuple(row for one in topics for row in one.differences()),
        byte_arrays=tuple(row for one in topics for row in one.bytes_compared()),
        without_numbers=tuple(one.name for one in topics if one.is_text),
        rejected_commands=(_rejected(first), _rejected(second)),
    )


def _versions(runs: tuple[RecordedRun, RecordedRun]) -> Iterator[Difference]:
    for group in ("obelisk_versions", "obelisk_code"):
        first, second = (run.metadata.get(group, {}) for run in runs)
        yield from _differences(first, second)


def _differences(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[Difference]:
    for key in dict.fromkeys((*first, *second)):
        if first.get(key) != second.get(key):
            yield Difference(what=key, first=first.get(key), second=second.get(key))


def _compare_plans(
    first: Mapping[str, Any], second: Mapping[str, Any]
) -> tuple[tuple[Difference, ...], tuple[Difference, ...]]:
    """Differences of the config without parameters, and of the nodes' parameters."""
    flat = [dict(_flat(_by_node(plan), "")) for plan in (first, second)]
    found = list(_differences(*flat))
    marks = [".parameters." in one.what for one in found]
    config = tuple(one for one, mark in zip(found, marks, strict=True) if not mark)
    parameters = (
        Difference(what=one.what.replace(".parameters.", " "), first=one.first, second=one.second)
        for one, mark in zip(found, marks, strict=True)
        if mark
    )
    return config, tuple(parameters)


def _by_node(plan: Mapping[str, Any]) -> dict[str, Any]:
    """A plan with its processes by name; locations in the config's text are ignored."""
    processes = plan.get("processes")
    nodes = {
        str(one.get("node")): one
        for one in (processes if isinstance(processes, list) else ())
        if isinstance(one, dict)
    }
    return {**{key: plan[key] for key in plan if key != "processes"}, **nodes}


def _flat(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Path -> value; long values, such as settings as text, are not split."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key != "origin":
                yield from _flat(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and any(isinstance(one, dict) for one in value):
        for place, inner in enumerate(value):
            yield from _flat(inner, f"{path}[{place}]")
    else:
        yield path, value


def _rejected(run: RecordedRun) -> int | None:
    """Number of commands that a run's robots rejected, according to their log."""
    if _ROSOUT in run.topics:
        topic = run.read([_ROSOUT]).get(_ROSOUT)
        lines = map(str, topic["msg"]) if topic is not None else iter(())
    else:
        try:
            text = run.path.with_name(LAUNCH_LOG).read_text(encoding="utf-8", errors="replace")
        except OSError:
            return None
        lines = iter(text.splitlines())
    counts = [int(match[1]) for line in lines if (match := _REJECTED.search(line))]
    return max(counts, default=0)


@dataclass(slots=True)
class _Sums:
    """Running sums of one signal's differences."""

    label: str
    unit: str
    square: float = 0.0
    largest: float = 0.0
    at_s: float = 0.0
    count: int = 0
    missing: tuple[int, int] = (0, 0)
    low: float = np.inf
    high: float = -np.inf

    def add(self, times: Floats, values: Floats, others: Floats) -> None:
        differences = values - others
        known = ~np.isnan(differences)
        absent = np.isnan(values), np.isnan(others)
        self.missing = (
            self.missing[0] + int((absent[0] & ~absent[1]).sum()),
            self.missing[1] + int((absent[1] & ~absent[0]).sum()),
        )
        if not known.any():
            return
        self.low = min(self.low, float(values[known].min()))
        self.high = max(self.high, float(values[known].max()))
        sizes = np.abs(differences[known])
        self.square += float(np.square(sizes).sum())
        self.count += len(sizes)
        place = int(np.argmax(sizes))
        if self.count == len(sizes) or sizes[place] > self.largest:
            self.largest, self.at_s = float(sizes[place]), float(times[known][place])


@dataclass(slots=True)
class _Topic:
    """One topic in both runs while they are read."""

    name: str
    is_in_both: bool
    waiting: tuple[list[RecordedTopic], list[RecordedTopic]] = field(
        default_factory=lambda: ([], [])
    )
    times: tuple[list[Floats], list[Floats]] = field(default_factory=lambda: ([], []))
    types: list[str] = field(default_factory=lambda: ["", ""])
    definitions: list[str] = field(default_factory=lambda: ["", ""])
    done_s: float = -np.inf
    sums: dict[_Key, _Sums] = field(default_factory=dict)
    hashes: tuple[dict[str, Any], dict[str, Any]] = field(default_factory=lambda: ({}, {}))
    """Path of a long array of bytes -> hash of its values so far."""
    is_text: bool = False
    """Whether messages of both runs were read, and none contains a number."""

    def add(self, place: int, part: RecordedTopic) -> None:
        """Add a part of a run's messages, and compare as far as both runs are known."""
        self.times[place].append(part.t)
        self.types[place] = part.msg_type
        self.definitions[place] = part.messages.definition
        if not self.is_in_both or not part.messages.definition:
            return
        for path, column in part.long_arrays(_MOST_NUMBERS).items():
            if column.code == _BYTE:
                _add_to_hash(self.hashes[place].setdefault(path, hashlib.blake2b()), part, path)
        self.waiting[place].append(part)
        firsts, seconds = self.waiting
        if not firsts or not seconds:
            return
        start, end = seconds[0].t[0], min(firsts[-1].t[-1], seconds[-1].t[-1])
        self.is_text = not (self.sums or any(self.hashes) or _labels_in([*firsts, *seconds]))
        self._compare(max(start, self.done_s), end)
        self.done_s = max(self.done_s, end)
        self._trim()

    def _compare(self, start: float, end: float) -> None:
        """Compare the first run's messages after `start` (the first time: from it) up to `end`."""
        firsts, seconds = self.waiting
        times = [_joined([part.t for part in parts]) for parts in (firsts, seconds)]
        is_first = not self.sums
        chosen = (times[0] >= start if is_first else times[0] > start) & (times[0] <= end)
        if not chosen.any():
            return
        at = times[0][chosen]
        order = np.argsort(times[1], kind="stable")  # messages are in order of receipt
        second_times = times[1][order]
        same = _places_of_same_times(at, second_times)
        for path, labels in _labels_in([*firsts, *seconds]).items():
            mine, theirs = (
                _joined([part.matrix(path, len(labels)) for part in parts])
                for parts in (firsts, seconds)
            )
            mine, theirs = mine[chosen], theirs[order]
            for place, (key, label, unit) in enumerate(labels):
                sums = self.sums.setdefault(key, _Sums(label, unit))
                others = _interpolated(at, second_times, theirs[:, place], same)
                sums.add(at, mine[:, place], others)

    def _trim(self) -> None:
        """Discard compared messages, except the second run's last part, needed to interpolate."""
        firsts, seconds = self.waiting
        while firsts and firsts[0].t[-1] <= self.done_s:
            del firsts[0]
        while len(seconds) > 1 and seconds[1].t[0] <= self.done_s:
            del seconds[0]

    def comparison(self) -> TopicComparison:
        times = [_joined(parts) if parts else np.empty(0) for parts in self.times]
        return TopicComparison(
            topic=self.name,
            msg_type=(self.types[0], self.types[1]),
            same_definition=self.definitions[0] == self.definitions[1] or not all(self.types),
            count=(len(times[0]), len(times[1])),
            rate_hz=(_rate_hz(times[0]), _rate_hz(times[1])),
            jitter_p99_ms=(_jitter_ms(times[0]), _jitter_ms(times[1])),
        )

    def differences(self) -> Iterator[SignalDifference]:
        for sums in self.sums.values():
            if sums.count or any(sums.missing):
                yield SignalDifference(
                    topic=self.name,
                    signal=sums.label,
                    unit=sums.unit,
                    rms=float(np.sqrt(sums.square / max(1, sums.count))),
                    largest=sums.largest,
                    at_s=sums.at_s,
                    count=sums.count,
                    missing=sums.missing,
                    span=sums.high - sums.low if sums.count else 0.0,
                )

    def bytes_compared(self) -> Iterator[BytesComparison]:
        first, second = ({path: h.digest() for path, h in one.items()} for one in self.hashes)
        for path in dict.fromkeys((*first, *second)):
            is_same = first.get(path) == second.get(path)
            yield BytesComparison(topic=self.name, field=path, is_same=is_same)


def _labels_in(parts: Sequence[RecordedTopic]) -> dict[str, list[tuple[_Key, str, str]]]:
    """All numbers in parts of a topic except times and long arrays of bytes.

    Returns:
        Path -> for each number of the field, which signal it belongs to, with label and unit.
    """
    found: dict[str, list[tuple[_Key, str, str]]] = {}
    for part in parts:
        if not part.has_numbers:
            continue
        long = part.long_arrays(_MOST_NUMBERS)
        for path, column in long.items():
            if column.code != _BYTE and not _STAMP.search(path):
                length = max(column.count or 0, len(found.get(path, ())))
                found[path] = [((path, None), path, part.unit(path))] * length
        for signal in part.signals(without=long):
            labels = found.setdefault(signal.path, [])
            if (signal.place or 0) == len(labels) and not _STAMP.search(signal.path):
                labels.append(((signal.path, signal.place), signal.label, signal.unit))
    return {path: labels for path, labels in found.items() if labels}


def _add_to_hash(value: Any, part: RecordedTopic, path: str) -> None:
    """Add the bytes of a field, message by message."""
    for row in part[path]:
        value.update(len(row).to_bytes(8, "little"))
        value.update(np.ascontiguousarray(row))


def _places_of_same_times(at: Floats, times: Floats) -> NDArray[np.int64]:
    """Return where each time is among sorted times, -1 if it is not.

    In lockstep, a topic may have several messages at one time: the second one corresponds to the
    second one.
    """
    order = np.argsort(at, kind="stable")
    in_order = at[order]
    numbers = np.empty(len(at), np.int64)
    numbers[order] = np.arange(len(at)) - np.searchsorted(in_order, in_order)
    places = np.searchsorted(times, at) + numbers
    is_same = times[np.minimum(places, len(times) - 1)] == at
    return np.where(is_same & (places < len(times)), places, -1)


def _interpolated(at: Floats, times: Floats, values: Floats, same: NDArray[np.int64]) -> Floats:
    """Interpolate, except at `same` places; next to NaN, only the values there are known."""
    found = np.interp(at, times, values)
    is_same = same >= 0
    found[is_same] = values[same[is_same]]
    return found


def _joined(parts: Sequence[Floats]) -> Floats:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _rate_hz(times: Floats) -> float:
    span = float(times[-1] - times[0]) if len(times) > 1 else 0.0
    return (len(times) - 1) / span if span > 0.0 else 0.0


def _jitter_ms(times: Floats) -> float:
    if len(times) < 3:
        return 0.0
    intervals = np.diff(times)
    return float(np.percentile(np.abs(intervals - intervals.mean()), 99.0)) * 1e3


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstDifference:
    """How far a topic's messages are the same in two runs."""

    count: int
    """Number of identical messages before the first one that differs."""
    at_s: float | None
    """When the first message that differs was published [s since activation]; None if none does."""
    late_s: float = 0.0
    """How much later an otherwise identical message is in the second run [s]."""

    def __str__(self) -> str:
        if self.at_s is None:
            return f"{with_number(self.count, 'message')}, bit-identical to the recording"
        # Time 0 is the activation of the whole stack; some of its nodes publish before.
        at = f"{abs(self.at_s):.4f} s" + (" before activation" if self.at_s < 0.0 else "")
        if self.count:
            text = f"identical up to message {self.count}, first difference at {at}"
        else:
            text = f"differs from the first message on, at {at}"
        if not self.late_s:
            return text
        word = "later" if self.late_s > 0.0 else "earlier"
        return f"{text}: same message, published {abs(self.late_s):.6g} s {word}"


def first_different_message(first: RecordedRun, second: RecordedRun, topic: str) -> FirstDifference:
    """Find the first message of a topic with other bytes or, in lockstep, of another time.

    Raises:
        RecordingError: a recording cannot be read.
    """
    count = 0
    both = (messages_in_order(run.path, [topic]) for run in (first, second))
    for one, two in zip_longest(*both):
        if one is None or two is None:
            run, message = (first, one) if one is not None else (second, two)
            at_s = (message.published_ns - run.origin_ns) * 1e-9
            return FirstDifference(count=count, at_s=at_s)
        late_ns = two.published_ns - one.published_ns if first.is_lockstep else 0
        if one.data != two.data or late_ns:
            at_s = (one.published_ns - first.origin_ns) * 1e-9
            late_s = late_ns * 1e-9 if one.data == two.data else 0.0
            return FirstDifference(count=count, at_s=at_s, late_s=late_s)
        count += 1
    return FirstDifference(count=count, at_s=None)


def _compare_topics(
    runs: tuple[RecordedRun, RecordedRun], only: Collection[str] | None
) -> list[_Topic]:
    """Read both runs side by side, always the one that is behind."""
    counts = [{one.topic for one in run.bag.topics if one.count} for run in runs]
    topics = {
        name: _Topic(name, name in counts[0] and name in counts[1])
        for name in sorted(counts[0] | counts[1])
        if (name != _ROSOUT if only is None else name in only)
    }
    readers = [run.parts(topics) for run in runs]
    progress = [-np.inf, -np.inf]
    while min(progress) < np.inf:
        place = int(progress[1] < progress[0])
        part = next(readers[place], None)
        if part is None:
            progress[place] = np.inf
            continue
        progress[place] = float(part.received[-1])
        topics[part.name].add(place, part)
    return [one for one in topics.values() if any(one.types)]
