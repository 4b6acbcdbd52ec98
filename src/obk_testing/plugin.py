"""The pytest plugin: the `stack` and `seed` fixtures, which run a config in lockstep.

Load it with `-p obk_testing.plugin`, as `obk test` does, so that simulated time is installed before
test modules and nodes are imported. A failed test leaves its trials as recordings and plots.
"""

import os
import re
import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from types import FrameType
from typing import Any, Final, NoReturn, Protocol

# Before the first import of rclpy and numpy: hides the nodes from other processes, and makes the
# order of sums fixed.
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import pytest  # noqa: E402
from rclpy.logging import LoggingSeverity, set_logger_level  # noqa: E402

from obelisk_py.core.lockstep.interception import intercepted  # noqa: E402
from obelisk_py.core.lockstep.scheduler import LockstepError  # noqa: E402
from obk_cli.errors import CommandFailedError  # noqa: E402
from obk_cli.plan.plan import Plan  # noqa: E402
from obk_cli.process.signals import (  # noqa: E402
    accept_interrupt,
    insist_on_interrupt,
    release_interrupts,
)
from obk_cli.workspace.overlay import import_from, overlay_prefixes  # noqa: E402
from obk_cli.workspace.package_index import PackageIndex  # noqa: E402
from obk_testing.kept_trials import (  # noqa: E402
    account_of,
    failure_reason,
    file_stem,
    node_id_of,
    write_trial,
)
from obk_testing.programs import LoadedStack, LoadedStacks  # noqa: E402
from obk_testing.result import TrialResult  # noqa: E402
from obk_testing.schedule import BringUp, Schedule, bring_up_times  # noqa: E402
from obk_testing.summary import TrialRecord, record_of, summary_lines, used_overrides  # noqa: E402
from obk_testing.trial import StackTrial  # noqa: E402

__all__ = ["StartStack", "trials_of"]

_SCHEDULE: Final = ("latency", "jitter", "phases", "compute", "bring_up")
_MOST_KEPT: Final = 10
"""Maximum number of failures that each process records per test; others can be repeated."""


class StartStack(Protocol):
    """The interface of the `stack` fixture."""

    def __call__(
        self,
        config: str | Path | None = None,
        *,
        seed: int = 0,
        parameters: Mapping[str, Mapping[str, Any]] | None = None,
        set: Sequence[str] = (),
        keyframe: str | None = None,
        latency: float | None = None,
        jitter: float | None = None,
        phases: bool | None = None,
        compute: Mapping[str, float] | None = None,
        bring_up: BringUp | None = None,
        watch: Iterable[str] = (),
        record: Iterable[str] | None = None,
        without: Iterable[str] = (),
    ) -> StackTrial:
        """Bring up a stack in lockstep.

        Unless one of `latency`, `jitter`, `phases`, `compute` and `bring_up` is set, the seed
        determines the schedule. Seed 0 gives the ideal one, in which nothing takes time.

        Args:
            config: path, relative to the folder of the test; None for the config of `obk test`.
            seed: seed of all random numbers.
            parameters: node -> parameter -> value, set before the nodes are configured.
            set: changes to the config, as for `obk launch --set`.
            keyframe: the initial keyframe of the simulation.
            latency: time from publishing a message to its arrival [s].
            jitter: maximum random addition to the latency, drawn for each message [s].
            phases: whether timers start at a random part of their period.
            compute: node -> computing time of each of its callbacks [s].
            bring_up: node -> when it becomes active [s]; or `measured`, as in the most recent real
                run of this stack on this machine; or the path of a run's folder.
            watch: topics that count as subscribed even without a subscriber.
            record: topics to record; None for all.
            without: nodes to leave out.

        Returns:
            The trial at time 0, with active nodes.
        """


@dataclass(slots=True)
class _Trials:
    """The trials of one test."""

    started: list[StackTrial] = field(default_factory=list)
    overridden: set[str] = field(default_factory=set)
    """Paths of `--stack-set` that a trial used."""
    schedules: set[str] = field(default_factory=set)
    """`ideal`, `varied` or `own`."""
    earlier: tuple[TrialResult, ...] = ()
    """Results of the first run of a test that runs twice."""
    earlier_wall_s: float = 0.0
    checked: str = ""

    @property
    def wall_s(self) -> float:
        """Wall time of the simulation [s]."""
        return self.earlier_wall_s + sum(trial.wall_s for trial in self.started)

    def results(self) -> tuple[TrialResult, ...]:
        return tuple(trial.result() for trial in self.started)

    def close(self) -> None:
        for trial in self.started:
            trial.close()


@dataclass(slots=True)
class _Session:
    """Data that a test run collects."""

    start_s: float = field(default_factory=perf_counter)
    patches: ExitStack = field(default_factory=ExitStack)
    records: list[TrialRecord] = field(default_factory=list)
    tests_run: int = 0
    kept: Counter[str] = field(default_factory=Counter)
    """Number of recorded failures by the name of the test, in this process."""


_SESSION: Final = pytest.StashKey[_Session]()
_TRIALS: Final = pytest.StashKey[_Trials]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the plugin's options."""
    group = parser.getgroup("obk", "closed-loop tests")
    group.addoption(
        "--seeds",
        default="1",
        help="number of seeds for tests with `seed`; `=17` runs only seed 17",
    )
    group.addoption(
        "--twice", action="store_true", help="run each test twice and compare its trials"
    )
    group.addoption(
        "--time-limit",
        type=float,
        metavar="SECONDS",
        help="start no test after this time; the first one always runs",
    )
    group.addoption("--keep-all", action="store_true", help="also keep recordings of passed tests")
    group.addoption("--keep-none", action="store_true", help="keep no recordings")
    group.addoption("--end-file", metavar="FILE", help="file to create when all tests have ended")
    group.addoption(
        "--trial-folder",
        metavar="DIR",
        help="folder for recordings and plots (default: build/obk-test in the root folder)",
    )
    group.addoption("--stack", metavar="CONFIG", help="the config for `stack()` without one")
    group.addoption(
        "--stack-set",
        metavar="PATH=VALUE",
        action="append",
        default=[],
        help="override a value of that config",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Install simulated time, and make the workspace's modules and messages importable."""
    _seeds(config)  # raises a usage error for an invalid option
    _import_from_workspace(config.rootpath)
    # lark, which ROS's message packages import, still uses this module.
    config.addinivalue_line(
        "filterwarnings",
        "ignore:module 'sre_(parse|constants)' is deprecated:DeprecationWarning",
    )
    if threading.current_thread() is threading.main_thread():
        # Like Ctrl-C, so that everything is cleaned up.
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    # Nodes of several trials have the same names, and lockstep does not use rcl's /rosout.
    set_logger_level("rcl.logging_rosout", LoggingSeverity.ERROR)
    session = config.stash[_SESSION] = _Session()
    session.patches.enter_context(intercepted())
    config.pluginmanager.register(_Reports(session), "obk_reports")
    limit_s = config.getoption("time_limit")
    if limit_s is not None:
        config.pluginmanager.register(_TimeLimit(session.start_s + limit_s), "obk_time_limit")


def _import_from_workspace(folder: Path) -> None:
    packages = PackageIndex.around(folder, folder, os.environ)
    sys.path[:0] = [str(path) for path in packages.source_packages.values()]
    import_from(overlay_prefixes(packages.workspaces))


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Stop the tests on Ctrl-C, which `obk test` holds back until pytest can handle it."""
    config = session.config
    if not config.getoption("end_file") or hasattr(config, "workerinput"):
        return
    config.stash[_SESSION].patches.enter_context(insist_on_interrupt())
    interrupt = signal.getsignal(signal.SIGINT)
    assert callable(interrupt)

    def interrupt_once(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # on a second one, `obk test` kills us
        interrupt(number, frame)

    signal.signal(signal.SIGINT, interrupt_once)
    release_interrupts()


def pytest_enter_pdb() -> None:
    """From now on, leave Ctrl-C to the debugger, which handles it at its prompt."""
    accept_interrupt()
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_keyboard_interrupt() -> None:
    """Do not interrupt the end of the session again."""
    accept_interrupt()


def pytest_unconfigure(config: pytest.Config) -> None:
    """Restore the system's functions."""
    if _SESSION in config.stash:
        config.stash[_SESSION].patches.close()


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Confirm the end of the tests.

    Also unregister hypothesis if tests do not use it, because its summary takes 0.5 s to import.
    """
    end_file = session.config.getoption("end_file")
    if end_file and not hasattr(session.config, "workerinput"):
        Path(end_file).touch()
    plugins = session.config.pluginmanager
    if "hypothesis" not in sys.modules and plugins.has_plugin("hypothesispytest"):
        plugins.unregister(name="hypothesispytest")


class _Reports:
    """Collects the records of all reports, including those of pytest-xdist workers."""

    def __init__(self, session: _Session) -> None:
        self._session = session

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._session.tests_run += report.when == "setup"
        record = record_of(report) if report.when == "call" else None
        if record is not None:
            self._session.records.append(record)


def _seed_of(item: pytest.Item) -> int:
    callspec = getattr(item, "callspec", None)
    return int(callspec.params.get("seed", 0)) if callspec is not None else 0


class _TimeLimit:
    """Skips the remaining tests when time is up, so that finished ones are reported."""

    def __init__(self, end_s: float) -> None:
        self._end_s = end_s
        self._has_run = False

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Sort by seed, so that all tests run for about the same number of seeds."""
        items.sort(key=_seed_of)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self) -> bool | None:
        """Skip a test after the time limit by claiming it; otherwise leave it to pytest."""
        if self._has_run and perf_counter() > self._end_s:
            return True
        self._has_run = True
        return None


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print passed trials, failures and how to repeat them."""
    session = config.stash[_SESSION]
    if not session.records:
        return
    terminalreporter.section("trials")
    lines = summary_lines(
        session.records,
        config=config.getoption("stack"),
        overrides=config.getoption("stack_set"),
        duration_s=perf_counter() - session.start_s,
        processes=int(config.getoption("numprocesses", None) or 1),
        twice=config.getoption("twice"),
    )
    for line in lines:
        terminalreporter.line(line)
    ran, limit_s = session.tests_run, config.getoption("time_limit")
    collected = terminalreporter._session.testscollected
    if limit_s is not None and ran < collected:
        terminalreporter.line(f"stopped after {limit_s:g} s: {ran} of {collected} tests ran")
    seeds = str(config.getoption("seeds"))
    if seeds != "1" and not any("seed" in record.node_id for record in session.records):
        terminalreporter.line(f"note: `--seeds {seeds}` has no effect: no test takes `seed`")


def _seeds(config: pytest.Config) -> Sequence[int]:
    given = str(config.getoption("--seeds"))
    match = re.fullmatch(r"(?P<one>=)?(?P<number>\d+)", given)
    if match is None or not (match["one"] or int(match["number"])):
        raise pytest.UsageError(
            f"`--seeds {given}`: expected a number of seeds, or `=SEED` for one"
        )
    number = int(match["number"])
    return (number,) if match["one"] else range(number)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that uses the `seed` fixture once per seed."""
    if "seed" in metafunc.fixturenames:
        seeds = _seeds(metafunc.config)
        metafunc.parametrize("seed", seeds, ids=[f"seed{seed}" for seed in seeds])


@pytest.fixture(scope="session")
def _stacks() -> Iterator[LoadedStacks]:
    """The stacks that are loaded in this process."""
    stacks = LoadedStacks()
    yield stacks
    stacks.close()


@pytest.fixture
def stack(request: pytest.FixtureRequest, _stacks: LoadedStacks) -> Iterator[StartStack]:
    """`stack("my_robot.yaml")` brings up a config in lockstep; see `StartStack`."""
    trials = request.node.stash[_TRIALS] = _Trials()

    def start(config: str | Path | None = None, **options: Any) -> StackTrial:
        __tracebackhide__ = True
        changes = options.pop("set", ())
        without = tuple(options.pop("without", ()))
        given = {name: options.pop(name, None) for name in _SCHEDULE}
        given = {name: value for name, value in given.items() if value is not None}
        loaded = _load(request, _stacks, config, changes, without)
        error: CommandFailedError | LockstepError | None = None
        try:
            if "bring_up" in given:
                folder = request.path.parent
                given["bring_up"] = bring_up_times(given["bring_up"], loaded.plan, folder)
            schedule = Schedule(**given) if given else None
            trial = StackTrial(loaded, schedule=schedule, **options)
        except (CommandFailedError, LockstepError) as raised:
            error = raised
        if error is not None:
            _fail(error)
        trials.started.append(trial)
        own = (*changes, *trial.parameter_paths())
        trials.overridden |= used_overrides(_config_of(request, config)[1], own)
        trials.schedules.add("own" if given else "varied" if trial.seed else "ideal")
        return trial

    yield start
    trials.close()
    del request.node.stash[_TRIALS]
    _stacks.trim()


def _load(
    request: pytest.FixtureRequest,
    stacks: LoadedStacks,
    config: str | Path | None,
    changes: Sequence[str] = (),
    without: tuple[str, ...] = (),
) -> LoadedStack:
    """Load a stack; if the config cannot be loaded, fail the test without a traceback."""
    path, settings = _config_of(request, config)
    loaded: LoadedStack | CommandFailedError
    try:
        loaded = stacks.get(path, (*settings, *changes), without=without)
    except CommandFailedError as error:
        loaded = error
    return loaded if isinstance(loaded, LoadedStack) else _fail(loaded)


def _fail(error: CommandFailedError | LockstepError) -> NoReturn:
    """Fail the test without a traceback; call this outside `except` to avoid an exception chain."""
    help = getattr(error, "help", None)
    pytest.fail(f"{error}\n  help: {help}" if help else str(error), pytrace=False)


@pytest.fixture
def given_plan(request: pytest.FixtureRequest, _stacks: LoadedStacks) -> Plan:
    """The plan of the config that was passed to `obk test`."""
    return _load(request, _stacks, None).plan


def _config_of(
    request: pytest.FixtureRequest, config: str | Path | None
) -> tuple[Path, Sequence[str]]:
    """Return the path of a config, and the command line's overrides if they apply to it."""
    options = request.config.option
    given = Path(request.config.invocation_params.dir, options.stack) if options.stack else None
    if config is None:
        if given is None:
            pytest.fail(
                "`stack()` without a config needs `obk test CONFIG`, or `--stack CONFIG`",
                pytrace=False,
            )
        return given.resolve(), options.stack_set
    path = (request.path.parent / config).resolve()
    is_given = given is not None and given.resolve() == path
    return path, options.stack_set if is_given else ()


def trials_of(item: pytest.Item) -> tuple[TrialResult, ...]:
    """Return the trials that a test has started so far."""
    trials = item.stash.get(_TRIALS, None)
    return trials.results() if trials is not None else ()


@pytest.fixture
def describe_check(request: pytest.FixtureRequest) -> Callable[[str], None]:
    """Set the sentence in the summary that describes what a test has checked."""

    def describe(sentence: str) -> None:
        request.node.stash[_TRIALS].checked = sentence

    return describe


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Generator[None, object, object]:
    """With `--twice`, run a test again with new nodes and compare the trials."""
    if not pyfuncitem.config.getoption("twice") or "stack" not in pyfuncitem.funcargs:
        return (yield)
    try:
        result = yield
        first_error: Exception | None = None
    except Exception as error:
        first_error, result = error, None
    trials = pyfuncitem.stash[_TRIALS]
    trials.earlier, trials.earlier_wall_s = trials.results(), trials.wall_s
    trials.close()
    trials.started.clear()
    names = pyfuncitem._fixtureinfo.argnames
    second_error = _error_of(pyfuncitem.obj, {name: pyfuncitem.funcargs[name] for name in names})
    difference = _first_difference(trials.earlier, trials.results())
    if difference is not None:
        pytest.fail(f"a second run of this test differs: {difference}", pytrace=False)
    if (first_error is None) != (second_error is None):
        pytest.fail(
            f"one of two runs with the same trials fails: {first_error or second_error}",
            pytrace=False,
        )
    if first_error is not None:
        raise first_error
    return result


def _error_of(call: Callable[..., object], arguments: Mapping[str, Any]) -> Exception | None:
    try:
        call(**arguments)
    except Exception as error:
        return error
    return None


def _first_difference(one: Sequence[TrialResult], two: Sequence[TrialResult]) -> str | None:
    if len(one) != len(two):
        return f"{len(one)} and {len(two)} trials"
    for number, (first, second) in enumerate(zip(one, two, strict=True)):
        difference = first.first_difference(second)
        if difference is not None:
            return (
                f"first at {difference}"
                if len(one) == 1
                else (f"trial {number + 1}, first at {difference}")
            )
    return None


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Keep the trials of a failed test, and record data for the summary."""
    report = yield
    trials = item.stash.get(_TRIALS, None)
    is_over = report.when == "call" and not report.skipped
    if is_over and trials is not None and (trials.started or report.failed):
        _keep(item, report, trials)
    return report


def _keep(item: pytest.Item, report: pytest.TestReport, trials: _Trials) -> None:
    config = item.config
    node_id = node_id_of(item)
    kept_before, name = config.stash[_SESSION].kept, getattr(item, "originalname", item.name)
    is_new = report.failed and kept_before[name] < _MOST_KEPT
    is_wanted = is_new or bool(config.getoption("keep_all"))
    is_kept = is_wanted and not config.getoption("keep_none")
    folder = Path(config.getoption("trial_folder") or config.rootpath / "build" / "obk-test")
    stem = file_stem(item)
    results = trials.results()
    reason = failure_reason(report)
    if not config.getoption("keep_none"):
        for old in [*folder.glob(f"{stem}.*")]:
            old.unlink()
    files: list[str] = []
    if is_kept:
        about = {"test": node_id, "outcome": report.outcome, "reason": reason}
        kept_before[name] += 1
        try:
            for ending, kept in (("", results), (".first", trials.earlier)):
                for number, result in enumerate(kept):
                    place = f".{number + 1}" if len(kept) > 1 else ""
                    path = folder / f"{stem}{place}{ending}.mcap"
                    title = f"{node_id}, seed {result.seed}: {reason}"
                    files += write_trial(path, result, title, about)
        except (CommandFailedError, OSError) as error:
            report.sections.append(("trials", f"the recording cannot be written: {error}"))
    if report.failed:
        report.sections += [("trial", "\n".join(account_of(result))) for result in results]
    seeds = [trial.seed for trial in trials.started]
    callspec = getattr(item, "callspec", None)
    seed = callspec.params.get("seed") if callspec is not None else None
    paths = [setting.partition("=")[0] for setting in config.getoption("stack_set")]
    record = TrialRecord(
        node_id=node_id,
        seed=seed if seed is not None else next(iter(seeds), None),
        simulated_s=sum(result.duration_s for result in (*results, *trials.earlier)),
        wall_s=trials.wall_s,
        trials=len(results) + len(trials.earlier),
        schedules=tuple(sorted(trials.schedules)),
        outcome=report.outcome,
        reason=reason,
        checked=trials.checked if report.passed else "",
        files=tuple(files),
        unused=tuple(path for path in paths if trials.started and path not in trials.overridden),
    )
    item.user_properties.append(record.as_property())
    report.user_properties.append(record.as_property())
