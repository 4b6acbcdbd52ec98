"""The summary of a test run: passed trials of each test, the worst failures, how to repeat them.

Each test stores a `TrialRecord` in its report, as plain data that pytest-xdist can send.
"""

import re
import shlex
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgspec

from obelisk_spec.suggestions import with_number
from obk_cli.terminal import plain

__all__ = [
    "PROPERTY",
    "TrialRecord",
    "record_of",
    "rerun_command",
    "summary_lines",
    "unused_notes",
    "used_overrides",
]

PROPERTY: Final = "obk_trials"
"""Name of the record among the properties of a report."""
_MOST_SHOWN: Final = 3
"""Maximum number of failures per test that are shown in full."""
_NUMBER: Final = r"(?:np\.\w+\()?(-?\d[\w.+-]*)\)?"
_COMPARED: Final = re.compile(rf"assert {_NUMBER} (<=?|>=?) {_NUMBER}")
_LONGEST: Final = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRecord:
    """Data about the trials of one test, for the summary."""

    node_id: str
    """Test id, as accepted by `--again`."""
    seed: int | None
    """None if the test has no seed."""
    simulated_s: float
    wall_s: float
    trials: int
    schedules: tuple[str, ...]
    """`ideal`, `varied` or `own`, without duplicates."""
    outcome: str = "passed"
    reason: str = ""
    """Reason of a failure, one line."""
    checked: str = ""
    """What a smoke test checked, one line."""
    files: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    """Paths of overrides on the command line that no trial used."""

    def as_property(self) -> tuple[str, str]:
        """Encode the record as a property of a report."""
        return PROPERTY, msgspec.json.encode(self).decode()


def record_of(report: Any) -> TrialRecord | None:
    """Decode the record in a report; None if it has none."""
    texts = [text for name, text in report.user_properties if name == PROPERTY]
    return msgspec.json.decode(texts[-1], type=TrialRecord) if texts else None


def rerun_command(
    config: str | None, overrides: Sequence[str], node_id: str, *, twice: bool = False
) -> str:
    """Return the command that repeats a test.

    Args:
        config: argument of `obk test`; None if pytest was called.
        overrides: `--set` options.
        node_id: id of the test.
        twice: whether `--twice` was given.
    """
    options = ("--twice",) if twice else ()
    if config is None:
        seed = re.search(r"\bseed(\d+)\b", node_id.partition("[")[2])
        seeds = ("--seeds", f"={seed[1]}") if seed else ()
        return shlex.join(["pytest", "-p", "obk_testing.plugin", *options, *seeds, node_id])
    settings = (word for setting in overrides for word in ("--set", setting))
    return shlex.join(["obk", "test", config, *settings, *options, "--again", node_id])


def used_overrides(settings: Iterable[str], changes: Sequence[str]) -> set[str]:
    """Return the paths of overrides that a test does not change itself.

    Args:
        settings: overrides on the command line, `PATH=VALUE`.
        changes: what the test changes, `PATH=VALUE` or `PATH`.
    """
    own = tuple(f"{_path(change)}." for change in changes)
    paths = (setting.partition("=")[0] for setting in settings)
    return {path for path in paths if not f"{_path(path)}.".startswith(own)}


def _path(setting: str) -> str:
    """Return the path of a setting in one form: `control.params.kd[1]` -> `control.0.params.kd.1`.

    A section that is a mapping counts as a list of one.
    """
    path = re.sub(r"\[(\d+)\]", r".\1", setting.partition("=")[0])
    section, dot, rest = path.partition(".")
    return path if rest[:1].isdecimal() else f"{section}.0{dot}{rest}"


def unused_notes(test: str, unused: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield a note on each override that no case of a test used.

    Args:
        test: name of the test.
        unused: of each case, the paths that its trials did not use.
    """
    cases = [*unused]
    for path in cases[0] if cases else ():
        if all(path in case for case in cases):
            yield f"`{path}` has no effect on {test}: it starts another config, or sets the value"


def summary_lines(
    records: Sequence[TrialRecord],
    *,
    config: str | None,
    overrides: Sequence[str],
    duration_s: float,
    processes: int,
    twice: bool = False,
) -> Iterator[str]:
    """Yield the lines of a summary.

    Args:
        records: records of all tests with trials.
        config: argument of `obk test`; None if pytest was called.
        overrides: `--set` options.
        duration_s: duration of the whole test run [s].
        processes: number of parallel processes.
        twice: whether `--twice` was given.
    """
    tests: defaultdict[str, list[TrialRecord]] = defaultdict(list)
    for record in records:
        tests[_without_seed(record.node_id)].append(record)
    width = max((len(name) for name in tests), default=0)
    for name, trials in tests.items():
        failed = sorted((t for t in trials if t.outcome != "passed"), key=_badness)
        passed = len(trials) - len(failed)
        yield f"{plain(name):<{width}}  {passed} of {len(trials)} passed{_worst(failed)}"
        yield from (f"  {plain(record.checked)}" for record in trials if record.checked)
        for record in failed[:_MOST_SHOWN]:
            again = rerun_command(config, overrides, record.node_id, twice=twice)
            yield from _failure(record, again)
        if len(failed) > _MOST_SHOWN:
            others = ", ".join(_seed(record) for record in failed[_MOST_SHOWN:])
            yield f"  and {_shortened(others)}"
        for record in trials:
            if record.outcome == "passed" and record.files:
                yield f"  kept: {', '.join(record.files)}"
        unused = (record.unused for record in trials)
        yield from (f"  note: {plain(note)}" for note in unused_notes(name, unused))
    yield _total(records, duration_s, processes)


def _without_seed(node_id: str) -> str:
    """Remove the seed from a test id; other parameters stay."""
    return re.sub(r"\[seed\d+\]|-seed\d+(?=\])|seed\d+-(?=[^\[]*\])", "", node_id)


def _seed(record: TrialRecord) -> str:
    return "failed" if record.seed is None else f"seed {record.seed}"


def _ratio(record: TrialRecord) -> float | None:
    """Return how far a failed comparison misses its limit; None if it compares no two numbers."""
    compared = _COMPARED.search(record.reason)
    if compared is None:
        return None
    value, limit = float(compared[1]), float(compared[3])
    if not compared[2].startswith("<"):
        value, limit = limit, value
    return value - limit


def _badness(record: TrialRecord) -> tuple[float, int]:
    """Sort key with the worst failure first: errors, then the largest misses."""
    miss = _ratio(record)
    return (float("-inf") if miss is None else -miss), record.seed or 0


def _worst(failed: Sequence[TrialRecord]) -> str:
    compared = _COMPARED.search(failed[0].reason) if failed else None
    if compared is None:
        return ""
    value, limit = float(compared[1]), float(compared[3])
    return f"   worst {value:.4g} (limit {limit:g}), {_seed(failed[0])}"


def _failure(record: TrialRecord, again: str) -> Iterator[str]:
    yield f"  {_seed(record)}: {_shortened(plain(record.reason))}"
    for file in record.files:
        yield f"    {file}"
    yield f"    again: {again}"


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _total(records: Sequence[TrialRecord], duration_s: float, processes: int) -> str:
    trials = sum(record.trials for record in records)
    simulated_s = sum(record.simulated_s for record in records)
    wall_s = sum(record.wall_s for record in records)
    kinds = Counter(kind for record in records for kind in record.schedules)
    names = {
        "ideal": "ideal schedule",
        "varied": "schedule varied by seed",
        "own": "own schedule",
    }
    schedules = ", ".join(
        name if len(kinds) == 1 else f"{name} in {with_number(kinds[kind], 'test')}"
        for kind, name in names.items()
        if kind in kinds
    )
    return (
        f"{with_number(trials, 'trial')}, {simulated_s:.1f} s simulated in "
        f"{_time(duration_s)} on {with_number(processes, 'core')}; "
        f"{simulated_s / wall_s if wall_s else 0.0:.1f}x real time; {schedules}"
    )


def _time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{seconds:.1f} s"
