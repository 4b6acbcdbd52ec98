"""Keep the trials of a test: names of its files, and the lines of its report."""

import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import pytest

from obk_testing.result import TrialResult

__all__ = ["account_of", "failure_reason", "file_stem", "node_id_of", "write_trial"]

_SHOWN_LOG: Final = 10
"""Maximum number of log entries in the report of a failed trial."""
_WARNING: Final = 30
_LONGEST_NAME: Final = 120
_SMOKE: Final = "smoke"


def _is_smoke(item: pytest.Item) -> bool:
    return item.path == Path(__file__).with_name("smoke.py")


def node_id_of(item: pytest.Item) -> str:
    """Return the id that runs the test from the folder of this run."""
    if _is_smoke(item):
        return item.name.replace("test_", "", 1)
    path = os.path.relpath(item.path, item.config.invocation_params.dir)
    return "::".join([path, *item.nodeid.split("::")[1:]])


def file_stem(item: pytest.Item) -> str:
    """Return the name of a test's files, independent of where the test run was started."""
    options = item.config.option
    start = item.config.invocation_params.dir
    base = Path(start, options.stack).parent if options.stack else item.config.rootpath
    parts = Path(os.path.relpath(item.path, base)).with_suffix("").parts
    names = [part for part in parts if part not in ("..", "tests")]
    if _is_smoke(item):
        names = []
    words = [*names, *item.nodeid.split("::")[1:-1], item.name.replace("test_smoke", _SMOKE)]
    text = re.sub(r"[^\w=]+", "-", "-".join(words)).strip("-")
    if len(text) <= _LONGEST_NAME:
        return text
    return f"{text[:_LONGEST_NAME]}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def failure_reason(report: pytest.TestReport) -> str:
    """Return one line with the reason why a test failed; empty if it did not."""
    if not report.failed:
        return ""
    crash = getattr(report.longrepr, "reprcrash", None)
    text = crash.message if crash is not None else str(report.longrepr)
    lines = [line for line in text.splitlines() if line.strip()]
    return re.sub(r"^(AssertionError|Failed): ", "", lines[0]) if lines else report.outcome


def write_trial(
    path: Path, result: TrialResult, title: str, about: Mapping[str, str]
) -> Iterator[str]:
    """Write the recording and, if possible, the plot of a trial; yield their paths."""
    from obk_testing.plot import draw_trial, is_drawable
    from obk_testing.recording import write_recording

    write_recording(path, result, about)
    yield os.path.relpath(path)
    picture = path.with_suffix(".png")
    if is_drawable() and draw_trial(result, title, picture):
        yield os.path.relpath(picture)


def account_of(result: TrialResult) -> Iterator[str]:
    """Yield the lines about a trial in the report of a failed test."""
    yield f"{result.facts.plan.name}, seed {result.seed}, {result.duration_s:g} s simulated"
    yield from (f"{one.t:.3f} s: {one.text}" for one in result.facts.interventions)
    yield from (f"fault: {fault}" for fault in result.faults)
    yield from (f"note: {note}" for note in result.notes)
    warnings = [entry for entry in result.log if entry.severity >= _WARNING]
    for entry in warnings[-_SHOWN_LOG:]:
        yield f"{entry.time_ns * 1e-9:.4f} s: {entry.name}: {entry.text}"
