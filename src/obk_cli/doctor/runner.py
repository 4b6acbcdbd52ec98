"""Run checks in parallel, each with a deadline: one that hangs or fails delays no other."""

import queue
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from obk_cli.clock import monotonic_s
from obk_cli.doctor.finding import Finding, error, warning
from obk_cli.errors import ObkError

__all__ = ["Answer", "Check", "examine"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """A check of the machine."""

    name: str
    about: str
    """One line for `obk doctor --list`."""
    find: Callable[[], Iterable[Finding]]
    """Examines the machine and returns the findings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What a check found."""

    check: str
    findings: tuple[Finding, ...]
    seconds: float
    """How long it took [s]."""


def examine(
    checks: Sequence[Check],
    *,
    timeout_s: float,
    on_pending: Callable[[tuple[str, ...]], None] = lambda _: None,
) -> tuple[Answer, ...]:
    """Run all checks at once.

    Args:
        checks: the checks to run.
        timeout_s: how long each may take [s].
        on_pending: called at the start and after each answer with the checks still running.

    Returns:
        An answer for each check, in their order.
    """
    answered: queue.Queue[Answer] = queue.Queue()
    begin = monotonic_s()
    for check in checks:
        run = threading.Thread(
            # A check that hangs must not keep the process from ending.
            target=lambda check=check: answered.put(_answer(check)),
            name=check.name,
            daemon=True,
        )
        run.start()
    answers: dict[str, Answer] = {}
    while len(answers) < len(checks):
        on_pending(tuple(check.name for check in checks if check.name not in answers))
        try:
            answer = answered.get(timeout=max(0.0, begin + timeout_s - monotonic_s()))
        except queue.Empty:
            break
        answers[answer.check] = answer
    return tuple(answers.get(check.name) or _late(check.name, timeout_s) for check in checks)


def _answer(check: Check) -> Answer:
    begin = monotonic_s()
    findings = tuple(_found(check))
    return Answer(check=check.name, findings=findings, seconds=monotonic_s() - begin)


def _found(check: Check) -> Iterable[Finding]:
    try:
        return tuple(check.find())
    except ObkError as fault:
        return (error(fault.message, fault.help or f"obk doctor {check.name}"),)
    except Exception as fault:  # the findings of the others still count
        sentence = f"the check itself failed: {type(fault).__name__}: {fault}"
        return (warning(sentence, f"obk doctor {check.name} --format json    # to report it"),)


def _late(name: str, timeout_s: float) -> Answer:
    sentence = f"did not finish within {timeout_s:.0f} s"
    finding = warning(sentence, f"obk doctor {name}    # run it alone")
    return Answer(check=name, findings=(finding,), seconds=timeout_s)
