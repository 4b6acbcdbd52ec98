"""Parallel checks: order, hangs, faults, and progress reports."""

import threading
from collections.abc import Iterator

import pytest

from obk_cli.doctor.checks import Check, examine
from obk_cli.doctor.finding import Finding, ok
from obk_cli.errors import CommandFailedError

from ....waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests
from .findings import the_one


def check(name: str, *findings: Finding) -> Check:
    return Check(name=name, about="", find=lambda: findings)


def test_results_have_the_order_of_the_checks_in_any_order_of_completion() -> None:
    is_second_done = threading.Event()

    def slow() -> Iterator[Finding]:
        assert is_second_done.wait(DEADLINE_S)
        yield ok("slow")

    def quick() -> Iterator[Finding]:
        yield ok("quick")
        is_second_done.set()

    checks = (Check(name="a", about="", find=slow), Check(name="b", about="", find=quick))
    pending: list[tuple[str, ...]] = []
    answers = examine(checks, timeout_s=DEADLINE_S, on_pending=pending.append)
    assert [answer.findings[0].message for answer in answers] == ["slow", "quick"]
    assert pending == [("a", "b"), ("a",)]


def test_a_hanging_check_loses_only_its_own_result(monkeypatch: pytest.MonkeyPatch) -> None:
    for_ever = threading.Event()
    now_s = 0.0

    def hang() -> tuple[Finding, ...]:
        for_ever.wait(DEADLINE_S)
        return ()

    def let_time_pass(pending: tuple[str, ...]) -> None:
        nonlocal now_s
        if pending == ("hangs",):
            now_s = DEADLINE_S

    monkeypatch.setattr("obk_cli.doctor.checks.monotonic_s", lambda: now_s)
    checks = (Check(name="hangs", about="", find=hang), check("well", ok("fine")))
    late, well = examine(checks, timeout_s=DEADLINE_S, on_pending=let_time_pass)
    for_ever.set()
    assert the_one(late.findings, "warning").fix.startswith("obk doctor hangs")
    assert the_one(well.findings, "ok").message == "fine"


def test_a_fault_of_the_surroundings_is_an_error_with_its_help() -> None:
    def fail() -> tuple[Finding, ...]:
        raise CommandFailedError("no domain is free", help="end a stack")

    (answer,) = examine((Check(name="x", about="", find=fail),), timeout_s=DEADLINE_S)
    found = the_one(answer.findings, "error")
    assert (found.message, found.fix) == ("no domain is free", "end a stack")


def test_a_broken_check_reports_itself() -> None:
    def fail() -> tuple[Finding, ...]:
        raise KeyError("oops")

    (answer,) = examine((Check(name="x", about="", find=fail),), timeout_s=DEADLINE_S)
    found = the_one(answer.findings, "warning")
    assert "KeyError: 'oops'" in found.message
