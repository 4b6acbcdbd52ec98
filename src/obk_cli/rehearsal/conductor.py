"""Carries out the cases of a rehearsal on running stacks and gives a row for each.

Starts a launcher for the cases, again whenever the one before has left no whole stack. Ends
everything that it started, whatever happens.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from obk_cli.adapters.clock import wall_s
from obk_cli.adapters.strokes import freeze, kill, thaw
from obk_cli.launch.events import AnswersAgain, Ended, Phase
from obk_cli.rehearsal.cases import Case
from obk_cli.rehearsal.judge import Row, has_concluded, judge, not_whole
from obk_cli.rehearsal.launched import Launched
from obk_cli.rehearsal.scene import Moment, Scene
from obk_cli.runs.lifecycle import ACTIVE

__all__ = ["Setting", "rehearse"]

UP_S: Final = 60.0
"""How long a bring-up may take; the launcher's own limits are shorter [s]."""
END_S: Final = 20.0
"""How long an orderly end may take [s]."""
DELAY_S: Final = 1.0
"""Less than what a launcher takes for a hang [s]."""
QUIET_S: Final = 1.5
"""How long a stack is watched after its reaction, or for none [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """How the stack of a rehearsal is launched."""

    command: tuple[str, ...]
    """`obk launch CONFIG --format json ...`"""
    environment: Mapping[str, str]
    """All of the launcher's variables."""
    runs: Path
    """The folder in which that launcher makes its run's."""


def rehearse(
    cases: Iterable[Case], setting: Setting, begin: Callable[[Case], None] = lambda _: None
) -> tuple[Row, ...]:
    """Carry out cases, one after another.

    Args:
        cases: what is done to the stack; in order, those that leave it whole best first.
        setting: how it is launched.
        begin: is told of each case before it.
    """
    rows: list[Row] = []
    with _stage(setting) as stage:
        for case in cases:
            begin(case)
            row = stage.play(case)
            rows.append(row)
            if not (row.is_right and case.leaves_stack_whole):
                rows[-1] = _with(row, stage.clear())
        if rows:
            rows[-1] = _with(rows[-1], stage.clear())
    return tuple(rows)


def _with(row: Row, faults: tuple[str, ...]) -> Row:
    return replace(row, faults=(*row.faults, *faults))


@contextmanager
def _stage(setting: Setting) -> Iterator["_Stage"]:
    stage = _Stage(setting)
    try:
        yield stage
    finally:
        stage.clear()


class _Stage:
    """The launcher of the moment, if there is one."""

    def __init__(self, setting: Setting) -> None:
        self._setting = setting
        self._launched: Launched | None = None

    def play(self, case: Case) -> Row:
        """Carry out a case on a stack that is up."""
        setting = self._setting
        if self._launched is None:
            self._launched = Launched(setting.command, setting.environment, setting.runs)
        launched = self._launched
        is_up = launched.wait_until(_is_up, UP_S)
        before = launched.status()
        faults = (*([] if is_up else _no_bring_up(launched)), *not_whole(before))
        if faults or before is None or launched.run is None:
            return Row(case=case, seen="not tried", faults=faults, run=launched.run)
        pid = next(node.pid for node in before.nodes if node.process == case.unit.name)
        assert pid is not None, "a whole stack has all of its processes"
        count = len(launched.moments)
        struck_s = _strike(case, pid, launched, count)
        code = launched.outcome(END_S)
        return judge(
            case,
            Scene(
                struck_s=struck_s,
                run=launched.run,
                before=before,
                moments=launched.moments[count:],
                after=launched.status() if code is None else None,
                exit_code=code,
                ended_s=launched.over_s,
                left=launched.clear_up() if code is not None else (),
            ),
        )

    def clear(self) -> tuple[str, ...]:
        """End the launcher; gives sentences on what was wrong with that."""
        if self._launched is None:
            return ()
        launched, self._launched = self._launched, None
        was_over = launched.exit_code is not None
        code = launched.end(END_S)
        left = tuple(f"left behind: {command}" for command in launched.clear_up())
        if was_over or code == 0:
            return left
        how = f"not ended {END_S:g} s later" if code is None else f"exit {code}"
        causes = [m.event.cause for m in launched.moments if isinstance(m.event, Ended)]
        return (f"asked to stop afterwards: {': '.join((how, *causes))}", *left)


def _is_up(moments: tuple[Moment, ...]) -> bool:
    return any(isinstance(m.event, Phase) and m.event.name == ACTIVE for m in moments)


def _no_bring_up(launched: Launched) -> tuple[str, ...]:
    causes = [m.event.cause for m in launched.moments if isinstance(m.event, Ended)]
    return (f"the stack did not come up: {' '.join(causes or launched.said) or 'no word'}",)


def _strike(case: Case, pid: int, launched: Launched, count: int) -> float:
    """Make the fault and wait for what comes of it; gives when it was made [s since 1970]."""
    struck_s = wall_s()
    (kill if case.fault == "kill" else freeze)(pid)
    try:
        if case.fault == "delay":
            launched.wait_until(_never, DELAY_S)
            thaw(pid)
        limit_s = QUIET_S if case.promise.reaction == "nothing" else case.promise.settled_s
        launched.wait_until(lambda told: has_concluded(case, told), limit_s, since=count)
        if case.promise.reaction == "stop":
            launched.wait_for_end(case.promise.settled_s - (wall_s() - struck_s))
        elif case.promise.reaction != "nothing":
            launched.wait_until(_never, QUIET_S)
    finally:
        if case.fault != "kill":
            thaw(pid)
    if case.fault == "freeze" and case.promise.reaction in ("go on", "nothing"):
        nodes = {node.full_name for node in case.unit.nodes if node.has_lifecycle}
        limit_s = case.promise.noticed_s
        launched.wait_until(lambda told: nodes <= _back(told), limit_s, since=count)
    return struck_s


def _never(_: tuple[Moment, ...]) -> bool:
    return False


def _back(moments: tuple[Moment, ...]) -> set[str]:
    return {m.event.node for m in moments if isinstance(m.event, AnswersAgain)}
