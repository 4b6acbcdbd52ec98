"""`python -m benchmarks`: all programs, or those that are left."""

import sys
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest

from benchmarks import __main__ as bench
from benchmarks.__main__ import PROGRAMS, left_of, main


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[list[str]]:
    """The words after `python -m` of all that is run; the launches fail."""
    found: list[list[str]] = []

    def run(command: list[str], **_: Any) -> CompletedProcess[bytes]:
        found.append(command[2:])
        return CompletedProcess(command, int("benchmarks.launches" in command))

    monkeypatch.setattr(bench.subprocess, "run", run)
    monkeypatch.setattr(bench, "DONE", tmp_path / "build" / "done")
    return found


def bench_with(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["bench", *words])
    return main()


def test_all_of_it_takes_forty_minutes() -> None:
    assert sum(program.minutes for program in PROGRAMS) <= 40


def test_what_is_done_is_left_out_and_so_is_what_was_not_asked_for() -> None:
    found = left_of(PROGRAMS, ["launches", "tool", "loop"], ["loop"])
    assert [program.name for program in found] == ["tool", "launches"]


def test_a_program_that_fails_stops_no_other_and_is_run_again(
    ran: list[list[str]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ("--parts", "loop", "launches", "watched")
    assert bench_with(monkeypatch, *asked) == 1
    assert [words[0].partition(".")[2] for words in ran] == [
        *("watched", "launches", "loop", "summary")
    ]
    assert capsys.readouterr().err == "failed: launches\n"
    ran.clear()
    assert bench_with(monkeypatch, *asked, "--go-on") == 1
    assert [words[0] for words in ran] == ["benchmarks.launches", "benchmarks.summary"]


def test_what_was_interrupted_goes_on_within_the_loop_too(
    ran: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert bench_with(monkeypatch, "--parts", "loop", "tool", "--go-on", "--peer", "/p") == 0
    assert ran[0][-1] == "/p"
    assert ran[1] == ["benchmarks.loop", "--go-on"]
    ran.clear()
    bench_with(monkeypatch, "--parts", "loop")  # begun anew
    assert ran[0] == ["benchmarks.loop"]
