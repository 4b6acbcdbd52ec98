"""When refusals are told, and as what, in a world whose time the test makes."""

import pytest

from obelisk_py.core.refusals import REFUSED_ON_END, Refusals


class World:
    """Refusals at one rate, and what is told of them."""

    def __init__(self):
        self.now_s = 50.0
        self.refusals = Refusals("control refused", lambda: self.now_s, REFUSED_ON_END)

    def refuse(self, seconds, *, accept_each=None):
        """What is told while one is refused each tenth of a second, as (time, report)."""
        told = []
        for count in range(1, round(seconds * 10) + 1):
            self.refusals.add("`u[0]` is nan")
            report = self.refusals.report()
            if report is not None:
                told.append((round(self.now_s, 1), report))
            if accept_each is not None and count % accept_each == 0:
                self.refusals.accept()
            self.now_s += 0.1
        return told


@pytest.fixture
def world():
    return World()


def test_nothing_but_refusals_is_an_error_after_a_second_and_then_told_rarely(world):
    first, *errors = world.refuse(25.0)
    assert first[0] == 50.0
    assert first[1].text == "control refused: `u[0]` is nan (1x); 1 since the start"
    assert not first[1].is_lasting
    assert [time_s for time_s, _ in errors] == pytest.approx([51.0, 61.0, 71.0], abs=0.11)
    assert all(report.is_lasting for _, report in errors)
    assert errors[0][1].text.startswith("control refused: `u[0]` is nan (1")
    assert "since the start; nothing else has come for 1." in errors[0][1].text
    assert errors[0][1].text.endswith("`obk topic echo` shows what the controller sends")


def test_one_that_is_accepted_now_and_then_leaves_it_a_warning(world):
    told = world.refuse(5.0, accept_each=9)
    assert len(told) == 5
    assert not any(report.is_lasting for _, report in told)


def test_of_what_has_no_cure_nothing_is_an_error():
    now_s = 0.0
    late = Refusals("control applied though late", lambda: now_s)
    late.add("its stamp is old")
    now_s = 100.0
    assert not late.report().is_lasting


def test_reasons_that_differ_each_time_make_no_endless_line():
    refusals = Refusals("control refused", lambda: 0.0)
    for value in range(1000):
        refusals.add(f"`u[0]` is {value}")
    text = refusals.report().text
    assert text.startswith("control refused: `u[0]` is 0 (1x); `u[0]` is 1 (1x); ")
    assert text.endswith("`u[0]` is 7 (1x); for further reasons (992x); 1000 since the start")
    refusals.add("`u[0]` is 9")
    assert refusals.report() is None
