"""Run the cases of a rehearsal on launched stacks, with a verdict for each.

The runner starts a launcher for the cases, and a new one after each case that left the stack
incomplete. It stops every process that it started.
"""

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import psutil

from obk_cli.clock import local_time, wall_s
from obk_cli.errors import CommandFailedError
from obk_cli.faultinject.expectations import Case
from obk_cli.faultinject.launched_stack import LaunchedStack
from obk_cli.faultinject.verdict import (
    Observation,
    TimedEvent,
    Verdict,
    has_concluded,
    incompleteness,
    verdict_of,
)
from obk_cli.files import explain_os_error
from obk_cli.launch.events import AnswersAgain, Ended, Phase
from obk_cli.runs.folder import WRITABLE_HOME, make_run_folder, run_folders
from obk_cli.runs.lifecycle import ACTIVE
from obk_cli.runs.registry import live_folders

__all__ = [
    "LaunchSettings",
    "freeze",
    "kill",
    "make_rehearsal_folder",
    "refuse_running",
    "run_cases",
    "thaw",
]

UP_S: Final = 60.0
"""Limit for a bring-up; the launcher's own limits are shorter [s]."""
END_S: Final = 20.0
"""Limit for a clean shutdown [s]."""
DELAY_S: Final = 1.0
"""Shorter than the launcher's limit for a hang [s]."""
QUIET_S: Final = 1.5
"""How long to watch a stack after its reaction, or if none is expected [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchSettings:
    """How the stack of a rehearsal is launched."""

    command: tuple[str, ...]
    """`obk launch CONFIG --format json ...`"""
    environment: Mapping[str, str]
    """The complete environment of the launcher."""
    runs: Path
    """The folder in which the launcher creates its run folder."""


def run_cases(
    cases: Iterable[Case],
    settings: LaunchSettings,
    on_case: Callable[[Case], None] = lambda _: None,
) -> tuple[Verdict, ...]:
    """Run cases one after another.

    Args:
        cases: ordered so that those that leave the stack complete come first, if possible.
        settings: how the stack is launched.
        on_case: called before each case.
    """
    verdicts: list[Verdict] = []
    with _session(settings) as session:
        for case in cases:
            on_case(case)
            verdict = session.run(case)
            verdicts.append(verdict)
            if not (verdict.is_right and case.leaves_stack_complete):
                verdicts[-1] = _with(verdict, session.clear())
        if verdicts:
            verdicts[-1] = _with(verdicts[-1], session.clear())
    return tuple(verdicts)


def _with(verdict: Verdict, faults: tuple[str, ...]) -> Verdict:
    return replace(verdict, faults=(*verdict.faults, *faults))


@contextmanager
def _session(settings: LaunchSettings) -> Iterator["_Session"]:
    session = _Session(settings)
    try:
        yield session
    finally:
        session.clear()


class _Session:
    """The current launcher, if any."""

    def __init__(self, settings: LaunchSettings) -> None:
        self._settings = settings
        self._stack: LaunchedStack | None = None

    def run(self, case: Case) -> Verdict:
        """Run a case on a stack that is up, launching one if necessary."""
        settings = self._settings
        if self._stack is None:
            self._stack = LaunchedStack(settings.command, settings.environment, settings.runs)
        stack = self._stack
        is_up = stack.wait_until(_is_up, UP_S)
        before = stack.status()
        faults = (*([] if is_up else _start_faults(stack)), *incompleteness(before))
        if faults or before is None or stack.run is None:
            return Verdict(case=case, observed="not tried", faults=faults, run=stack.run)
        pid = next(node.pid for node in before.nodes if node.process == case.unit.name)
        assert pid is not None, "a complete stack has all of its processes"
        count = len(stack.events)
        injected_s = _inject(case, pid, stack, count)
        code = stack.outcome(END_S)
        return verdict_of(
            case,
            Observation(
                injected_s=injected_s,
                run=stack.run,
                before=before,
                events=stack.events[count:],
                after=stack.status() if code is None else None,
                exit_code=code,
                ended_s=stack.over_s,
                left=stack.clear_up() if code is not None else (),
            ),
        )

    def clear(self) -> tuple[str, ...]:
        """Stop the launcher; return what went wrong."""
        if self._stack is None:
            return ()
        stack, self._stack = self._stack, None
        was_over = stack.exit_code is not None
        code = stack.end(END_S)
        left = tuple(f"left running: {command}" for command in stack.clear_up())
        if was_over or code == 0:
            return left
        how = f"still running after {END_S:g} s" if code is None else f"exit {code}"
        causes = [m.event.cause for m in stack.events if isinstance(m.event, Ended)]
        return (f"the stop after the case failed: {': '.join((how, *causes))}", *left)


def _is_up(events: tuple[TimedEvent, ...]) -> bool:
    return any(isinstance(m.event, Phase) and m.event.name == ACTIVE for m in events)


def _start_faults(stack: LaunchedStack) -> tuple[str, ...]:
    causes = [m.event.cause for m in stack.events if isinstance(m.event, Ended)]
    return (f"the stack did not start: {' '.join(causes or stack.other_output) or 'no output'}",)


def _inject(case: Case, pid: int, stack: LaunchedStack, count: int) -> float:
    """Inject the fault and wait for the reaction; return the time of the fault [s since 1970]."""
    injected_s = wall_s()
    (kill if case.fault == "kill" else freeze)(pid)
    try:
        if case.fault == "delay":
            stack.wait_until(_never, DELAY_S)
            thaw(pid)
        limit_s = QUIET_S if case.expectation.reaction == "nothing" else case.expectation.settled_s
        stack.wait_until(lambda events: has_concluded(case, events), limit_s, since=count)
        if case.expectation.reaction == "stop":
            stack.wait_for_end(case.expectation.settled_s - (wall_s() - injected_s))
        elif case.expectation.reaction != "nothing":
            stack.wait_until(_never, QUIET_S)
    finally:
        if case.fault != "kill":
            thaw(pid)
    if case.fault == "freeze" and case.expectation.reaction in ("go on", "nothing"):
        nodes = {node.full_name for node in case.unit.nodes if node.has_lifecycle}
        limit_s = case.expectation.detected_s
        stack.wait_until(lambda events: nodes <= _responding(events), limit_s, since=count)
    return injected_s


def _never(_: tuple[TimedEvent, ...]) -> bool:
    return False


def _responding(events: tuple[TimedEvent, ...]) -> set[str]:
    return {m.event.node for m in events if isinstance(m.event, AnswersAgain)}


def refuse_running(runs: Path, name: str) -> None:
    """Reject a stack that is already running on this host, in any ROS domain.

    Args:
        runs: the folder of all runs.
        name: the config's name.

    Raises:
        CommandFailedError: the stack is running.
    """
    other = next((run for run in live_folders(runs).values() if run.name == name), None)
    if other is not None:
        raise CommandFailedError(
            f"the stack `{name}` is running in ROS domain {other.domain} (process {other.pid}), "
            "and a rehearsal at the same time would disturb both",
            help=f"stop it with `obk stop {name}`",
        )


KEPT: Final = 10
"""Number of rehearsals whose logs are kept."""


def make_rehearsal_folder(parent: Path, name: str) -> Path:
    """Create the folder of a new rehearsal, and remove the oldest ones.

    Rehearsals have a folder of their own, so that they never displace the logs of other runs.

    Args:
        parent: the folder of all rehearsals.
        name: the config's name.

    Raises:
        CommandFailedError: the folder cannot be created.
    """
    try:
        home = make_run_folder(parent, name, local_time())
    except OSError as error:
        raise CommandFailedError(
            f"the folder for the logs of the rehearsal cannot be created in {parent}: "
            f"{explain_os_error(error)}",
            help=WRITABLE_HOME,
        ) from error
    for old in run_folders(parent)[KEPT:]:
        if not live_folders(old / "runs"):
            shutil.rmtree(old, ignore_errors=True)
    return home


def kill(pid: int) -> None:
    """Kill a process as the kernel does when memory runs out, but not its children."""
    with suppress(psutil.Error):
        psutil.Process(pid).kill()


def freeze(pid: int) -> None:
    """Stop a process and its descendants, so that a program behind a script freezes with it."""
    for process in _family(pid):
        with suppress(psutil.Error):
            process.suspend()


def thaw(pid: int) -> None:
    """Resume a frozen process and its descendants."""
    for process in _family(pid):
        with suppress(psutil.Error):
            process.resume()


def _family(pid: int) -> Iterator[psutil.Process]:
    with suppress(psutil.Error):
        process = psutil.Process(pid)
        yield process
        yield from process.children(recursive=True)
