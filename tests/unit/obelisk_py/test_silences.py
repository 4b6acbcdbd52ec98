"""When it is told that commands stopped, in a world whose time the test makes."""

import pytest

from obelisk_py.core.silences import GRACE_S, PERIOD_S, Silences


@pytest.fixture
def silences():
    return Silences()


def test_a_silence_is_told_once_a_grace_is_over(silences):
    assert silences.due_s is None
    silences.begin(100.0)
    assert silences.due_s == 100.0 + GRACE_S
    assert silences.report(100.5, 0.55) == "no command for 0.550 s"
    assert silences.due_s is None


def test_that_commands_come_again_is_news_only_after_it_was_told_that_none_came(silences):
    silences.begin(100.0)
    assert not silences.end(0.2)
    assert silences.report(100.5, None) == "commands stopped 1x, for 0.200 s at most"
    silences.begin(200.0)
    silences.report(200.5, 0.55)
    assert silences.end(3.0)
    silences.begin(300.0)
    assert not silences.end(0.3)


def test_silences_now_and_then_are_counted_and_told_each_ten_seconds(silences):
    told = []
    for tenth in range(1000, 1300, 2):
        now_s = tenth / 10
        if silences.due_s is not None and now_s >= silences.due_s:
            told.append((now_s, silences.report(now_s, None)))
        silences.begin(now_s)
        silences.end(0.1)
    assert [now_s for now_s, _ in told] == pytest.approx([100.6, 110.6, 120.6])
    assert told[1][1] == "commands stopped 50x, for 0.100 s at most"


def test_a_silence_that_lasts_is_told_as_such_among_others(silences):
    silences.begin(100.0)
    silences.report(100.5, 0.55)
    silences.end(0.6)
    for second in (101.0, 102.0):
        silences.begin(second)
    assert silences.due_s == 100.5 + PERIOD_S
    text = silences.report(110.5, 8.55)
    assert text == "commands stopped 2x, and none has come for 8.550 s"


def test_what_is_forgotten_is_not_told(silences):
    silences.begin(100.0)
    silences.forget()
    assert silences.due_s is None
    silences.begin(200.0)
    assert silences.report(201.0, 1.05) == "no command for 1.050 s"
