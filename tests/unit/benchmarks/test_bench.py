"""`python -m benchmarks`: all programs, or those that are left."""

from benchmarks.__main__ import PROGRAMS, left_of


def test_all_of_it_takes_forty_minutes() -> None:
    assert sum(program.minutes for program in PROGRAMS) <= 40


def test_what_is_done_is_left_out_and_so_is_what_was_not_asked_for() -> None:
    found = left_of(PROGRAMS, ["launches", "tool", "loop"], ["loop"])
    assert [program.name for program in found] == ["tool", "launches"]
