"""Run cases of a sweep in a process: `python -m obk_testing.sweep.worker`.

The worker runs pytest with a custom loop, so tests behave as under `obk test`: fixtures, marks,
`conftest.py` and rewritten assertions all work. The config is loaded once. Every case has its own
fixtures, except those of session scope.

Standard input: a line of JSON for the sweep (`WorkerSettings`), then one `SweepCase` per line.
Standard output: a line for the worker (`Hello`), then one per case (`Row`). Output of tests and
nodes goes to stderr.
"""

import ctypes
import hashlib
import json
import os
import platform
import re
import signal
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from numbers import Real
from pathlib import Path
from time import perf_counter
from typing import Any, Final, TextIO

import pytest

from obk_cli.optional_deps import distribution_version
from obk_cli.workspace.package_index import find_workspace
from obk_testing.summary import PROPERTY, record_of
from obk_testing.sweep.cases import FoundTest, Row, SweepCase
from obk_testing.sweep.files_read import FilesRead

__all__ = ["Hello", "WorkerSettings", "machine"]

_PR_SET_PDEATHSIG: Final = 1
_SMOKE_TEST: Final = Path(__file__).parents[1] / "smoke.py"
_INSTALLED: Final = "site-packages"
_LIBRARIES: Final = ("obelisk-cli", "mujoco", "numpy", "pytest")


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerSettings:
    """The settings of a worker."""

    config: str
    """Absolute path."""
    tests: tuple[str, ...]
    """Files, folders or tests for pytest, absolute paths; empty for the smoke test."""
    parent: int
    """Id of the process whose end also ends the worker."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hello:
    """The report of a worker when it is ready."""

    tests: tuple[FoundTest, ...]
    files: tuple[str, ...]
    """The modules of the tests, and the workspace's modules that they import."""
    left_out: int
    """Number of tests that do not use the `stack` fixture."""
    problem: str
    """Why tests could not be collected; empty if they could."""
    machine: Mapping[str, str]


def machine() -> dict[str, str]:
    """Return everything besides the inputs on which the bits of a run depend."""
    cpu = re.search(r"^model name\s*: (.*)$", _text(Path("/proc/cpuinfo")), re.MULTILINE)
    versions = {name: distribution_version(name) or "" for name in _LIBRARIES}
    return {
        "cpu": cpu[1].strip() if cpu else platform.machine(),
        "cores": str(os.cpu_count()),
        "system": platform.platform(),
        "python": platform.python_version(),
        **{name: version for name, version in versions.items() if version},
    }


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""


class _CaseLoop:
    """The pytest plugin that finds the tests of a sweep and runs cases on request."""

    def __init__(self, settings: WorkerSettings, cases: TextIO, results: TextIO) -> None:
        self._config = Path(settings.config)
        # Ids with parameters, in the form of reports: without the seed.
        self._variants = tuple(f"::{_name(test)}" for test in settings.tests if _parameters(test))
        self._cases = cases
        self._results = results
        self._reports: list[pytest.TestReport] = []
        self._problems: list[str] = []
        self._digest = ""
        self._folders = _folders(self._config.parent, settings.tests)
        self._files = FilesRead(self._folders)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Record why a module cannot be imported."""
        if report.failed:
            self._problems.append(str(report.longrepr))

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run cases until the input ends."""
        found = {
            FoundTest(
                node_id=_id_of(item, self._config.parent), takes_seed="seed" in item.fixturenames
            ): item
            for item in session.items
            if isinstance(item, pytest.Function) and "stack" in item.fixturenames
        }
        if self._variants:
            found = {
                test: item
                for test, item in found.items()
                if any(id.endswith(self._variants) for id in (test.name, test.node_id))
            }
        hello = Hello(
            tests=tuple(found),
            files=tuple(sorted(_files_of(session.items, self._folders))),
            left_out=len(session.items) - len(found),
            problem="\n".join(self._problems),
            machine=machine(),
        )
        self._send(asdict(hello))
        items = {test.name: item for test, item in found.items()}
        for line in self._cases:
            case = case_of(json.loads(line))
            if case.test in items:
                row = self._run(items[case.test], case)
            else:  # on a machine other than the one that selected the cases
                why = hello.problem.strip().rpartition("\n")[2].removeprefix("E").strip()
                row = Row(key=case.key, outcome="died", why=why, worker=_worker())
            self._send(row.data())
        return True

    def _run(self, pattern: pytest.Function, case: SweepCase) -> Row:
        session = pattern.session
        session.config.option.seeds = f"={case.seed or 0}"
        session.config.option.stack_set = list(case.settings)
        self._reports, self._digest = [], ""
        start = perf_counter()
        item = _item_of(pattern, case.node_id, self._config.parent)
        # Only session-scoped objects outlive a case, so that no case depends on earlier ones.
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=session)
        row = _row(case, self._reports, self._digest, perf_counter() - start)
        return replace(row, files=self._files.take())

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Iterator[None]:
        """Compute the digest of the trials while they exist."""
        from obk_testing.plugin import trials_of  # pytest must load it first

        if call.when == "call":
            digests = [result.digest() for result in trials_of(item)]
            joined = hashlib.sha256("".join(digests).encode()).hexdigest()
            self._digest = digests[0] if len(digests) == 1 else joined if digests else ""
        return (yield)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the reports of the case."""
        self._reports.append(report)

    def _send(self, data: Mapping[str, Any]) -> None:
        print(json.dumps(data, default=_plain), file=self._results, flush=True)


def _plain(value: object) -> float | str:
    """A value without a form in JSON: one of numpy's numbers as a float, anything else as text."""
    return float(value) if isinstance(value, Real) else str(value)


def case_of(data: Mapping[str, Any]) -> SweepCase:
    """Decode a case from JSON."""
    overrides = tuple((path, value) for path, value in data["overrides"])
    return SweepCase(**{**data, "overrides": overrides})


def _folders(folder: Path, tests: Iterable[str]) -> frozenset[Path]:
    """Return the folders with the user's files: of the config, of its workspace, of the tests."""
    paths = [Path(test.partition("::")[0]) for test in tests]
    of_tests = (path if path.is_dir() else path.parent for path in paths)
    return frozenset({find_workspace(folder), folder, *of_tests})


def _files_of(items: Sequence[pytest.Item], around: frozenset[Path]) -> set[str]:
    """Return the modules of tests, and all imported modules in some folders."""
    tests = {item.path for item in items}
    imported = (getattr(module, "__file__", None) for module in [*sys.modules.values()])
    paths = {Path(file) for file in imported if file}
    own = {path for path in paths if not around.isdisjoint(path.parents)}
    return {str(path) for path in tests | own if _INSTALLED not in path.parts}


def _name(test: str) -> str:
    """Return the part of a test's id after the file, `test_push[down]`."""
    return test.partition("::")[2]


def _parameters(test: str) -> str:
    """Return the parameters in a test's id, `[down]`; empty if there are none."""
    _, bracket, rest = _name(test).partition("[")
    return f"{bracket}{rest}"


def _id_of(item: pytest.Item, folder: Path) -> str:
    """Return a test's id relative to a folder; pytest has no such id for tests outside it."""
    if item.path == _SMOKE_TEST:
        return item.name.removeprefix("test_")
    return f"{os.path.relpath(item.path, folder)}::{item.nodeid.partition('::')[2]}"


def _item_of(pattern: pytest.Function, node_id: str, folder: Path) -> pytest.Item:
    """Create a test for the seed in the session's options, as collection does."""
    collector: Any = pattern.parent  # a module or a class
    collected = collector.ihook.pytest_pycollect_makeitem(
        collector=collector,
        name=pattern.originalname,
        obj=getattr(collector.obj, pattern.originalname),
    )
    items = [item for item in collected if _id_of(item, folder) == node_id]
    session = pattern.session
    session.config.hook.pytest_collection_modifyitems(
        session=session, config=session.config, items=items
    )
    found: pytest.Item = items[0]
    return found


def _row(case: SweepCase, reports: Sequence[pytest.TestReport], digest: str, seconds: float) -> Row:
    wrong = next((report for report in reports if report.failed), None)
    skipped = next((report for report in reports if report.skipped), None)
    properties = [pair for report in reports for pair in report.user_properties]
    record = next(filter(None, map(record_of, reports)), None)
    metrics = {name: value for name, value in properties if name != PROPERTY}
    return Row(
        key=case.key,
        outcome="failed" if wrong else "skipped" if skipped else "passed",
        why=_why(wrong) if wrong else _reason(skipped) if skipped else "",
        metrics=metrics,
        digest=digest,
        seconds=seconds,
        worker=_worker(),
        unused=record.unused if record is not None else (),
    )


def _worker() -> str:
    return f"{platform.node()}:{os.getpid()}"


def _why(report: pytest.TestReport) -> str:
    """Return the first line of a failed test's message, with its location."""
    crash = getattr(report.longrepr, "reprcrash", None)
    text = str(report.longrepr) if crash is None else str(crash.message)
    first = re.sub(r"^(AssertionError|Failed): ", "", text.strip().partition("\n")[0])
    place = f" ({Path(crash.path).name}:{crash.lineno})" if crash is not None else ""
    phase = "" if report.when == "call" else f"{report.when}: "
    return f"{phase}{first}{place}"


def _reason(report: pytest.TestReport) -> str:
    reason = report.longrepr
    return str(reason[2] if isinstance(reason, tuple) else reason or "expected to fail")


def main() -> None:
    """Run the cases from standard input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process handles Ctrl-C
    cases = os.fdopen(os.dup(0), encoding="utf-8")
    results = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    with Path(os.devnull).open(encoding="utf-8") as nothing:
        os.dup2(nothing.fileno(), 0)
    given = json.loads(cases.readline() or "null")
    if given is None:
        return
    settings = WorkerSettings(**{**given, "tests": tuple(given["tests"])})
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != settings.parent:
        return
    arguments = [
        *("-p", "obk_testing.plugin", "-p", "no:cacheprovider", "--quiet", "--tb=short"),
        *("--continue-on-collection-errors", "--keep-none", "--stack", settings.config),
        *(["-n0"] if find_spec("xdist") else []),
        f"--rootdir={Path(settings.config).parent}",
        *(
            [test.removesuffix(_parameters(test)) for test in settings.tests]
            or ("-c", os.devnull, str(_SMOKE_TEST))
        ),
    ]
    sys.exit(pytest.main(arguments, plugins=[_CaseLoop(settings, cases, results)]))


if __name__ == "__main__":
    main()
