"""The table of checks: a probe gathers facts, a judge interprets them."""

import queue
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from obk_cli.clock import monotonic_s
from obk_cli.doctor.finding import Finding, error, warning
from obk_cli.doctor.installation import judge_paths, judge_python, probe_paths, probe_python
from obk_cli.doctor.interfaces import (
    judge_compiler,
    judge_interfaces,
    probe_compiler,
    probe_interfaces,
)
from obk_cli.doctor.machine import (
    judge_cpu,
    judge_folders,
    judge_realtime,
    judge_shared_memory,
    judge_transport,
    probe_cpu,
    probe_folders,
    probe_realtime,
    probe_shared_memory,
    probe_transport,
)
from obk_cli.doctor.mujoco import judge_display, judge_mujoco, probe_display, probe_mujoco
from obk_cli.doctor.network import (
    judge_discovery,
    judge_multicast,
    probe_discovery,
    probe_multicast,
)
from obk_cli.doctor.ros import judge_rmw, judge_ros, probe_rmw, probe_ros
from obk_cli.doctor.workspace import (
    judge_stacks,
    judge_workspace,
    probe_stacks,
    probe_workspace,
)
from obk_cli.errors import ObkError

__all__ = ["Answer", "Check", "checks_of", "examine"]


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
    """Duration [s]."""


def examine(
    checks: Sequence[Check],
    *,
    timeout_s: float,
    on_pending: Callable[[tuple[str, ...]], None] = lambda _: None,
) -> tuple[Answer, ...]:
    """Run all checks at once.

    Args:
        checks: the checks to run, in parallel.
        timeout_s: limit for each check [s].
        on_pending: called with the checks that are still running, at the start and after each
            answer.

    Returns:
        The answers, in the order of the checks.
    """
    answered: queue.Queue[Answer] = queue.Queue()
    start = monotonic_s()
    for check in checks:
        run = threading.Thread(
            # A daemon thread: a check that hangs must not keep the process from exiting.
            target=lambda check=check: answered.put(_answer(check)),
            name=check.name,
            daemon=True,
        )
        run.start()
    answers: dict[str, Answer] = {}
    while len(answers) < len(checks):
        on_pending(tuple(check.name for check in checks if check.name not in answers))
        try:
            answer = answered.get(timeout=max(0.0, start + timeout_s - monotonic_s()))
        except queue.Empty:
            break
        answers[answer.check] = answer
    return tuple(answers.get(check.name) or _late(check.name, timeout_s) for check in checks)


def _answer(check: Check) -> Answer:
    start = monotonic_s()
    findings = tuple(_found(check))
    return Answer(check=check.name, findings=findings, seconds=monotonic_s() - start)


def _found(check: Check) -> Iterable[Finding]:
    try:
        return tuple(check.find())
    except ObkError as fault:
        return (error(fault.message, fault.help or f"obk doctor {check.name}"),)
    except Exception as fault:  # the other checks still count
        sentence = f"the check itself failed: {type(fault).__name__}: {fault}"
        return (warning(sentence, f"obk doctor {check.name} --format json    # to report it"),)


def _late(name: str, timeout_s: float) -> Answer:
    sentence = f"did not finish within {timeout_s:.0f} s"
    finding = warning(sentence, f"obk doctor {name}    # run it alone")
    return Answer(check=name, findings=(finding,), seconds=timeout_s)


Facts = TypeVar("Facts")


def _check(
    name: str, about: str, probe: Callable[[], Facts], judge: Callable[[Facts], Iterable[Finding]]
) -> Check:
    return Check(name=name, about=about, find=lambda: judge(probe()))


OF_ROS: Final = (
    _check("python", "Python's version and environment", probe_python, judge_python),
    _check("ros", "the ROS 2 in use and its version", probe_ros, judge_ros),
    _check("rmw", "middleware, ROS domain, discovery", probe_rmw, judge_rmw),
    _check("interfaces", "loading Obelisk's messages", probe_interfaces, judge_interfaces),
    _check("multicast", "UDP on this host", probe_multicast, judge_multicast),
    _check("discovery", "two ROS processes find each other", probe_discovery, judge_discovery),
)
"""Needed to exchange messages; later checks depend on earlier ones."""
OF_THE_MACHINE: Final = (
    _check("shared-memory", "free space in /dev/shm", probe_shared_memory, judge_shared_memory),
    _check("compiler", "C and C++ compilers, Python headers", probe_compiler, judge_compiler),
    _check("mujoco", "stepping and rendering a scene", probe_mujoco, judge_mujoco),
    _check("display", "a display for windows", probe_display, judge_display),
    _check("realtime", "priority and locked memory", probe_realtime, judge_realtime),
    _check("cpu", "processors, their load, the clock", probe_cpu, judge_cpu),
)


def checks_of(environment: Mapping[str, str], working_folder: Path) -> tuple[Check, ...]:
    """Every check, in the order of the report.

    Args:
        environment: the shell's variables.
        working_folder: the current folder.
    """
    return (
        *OF_ROS,
        *OF_THE_MACHINE,
        _check(
            "transport",
            "local sockets between the nodes of a run",
            lambda: probe_transport(environment),
            judge_transport,
        ),
        _check(
            "folders",
            "disk space for runs, caches, temporary files",
            lambda: probe_folders(environment),
            judge_folders,
        ),
        _check(
            "workspace",
            "packages here and their build state",
            lambda: probe_workspace(working_folder, environment),
            judge_workspace,
        ),
        _check(
            "paths",
            "conflicting installations of obk, ROS or Python",
            lambda: probe_paths(environment),
            judge_paths,
        ),
        _check(
            "stacks",
            "running stacks and leftover processes",
            lambda: probe_stacks(environment),
            judge_stacks,
        ),
    )
