"""When the newest command is too old, in a world whose time the test makes."""

import pytest

from obelisk_py.core.command_age import CommandAge, StalePolicy


@pytest.fixture
def age():
    return CommandAge(StalePolicy(max_age_s=0.5, action="zero"))


def test_nothing_is_counted_before_the_first_command(age):
    assert age.deadline_s is None
    assert age.look(1e9) is None
    assert not age.is_stale


def test_a_command_is_too_old_right_after_its_deadline_and_not_at_it(age):
    age.accept(10.0)
    assert age.deadline_s == 10.5
    assert age.look(10.5) is None
    assert age.look(10.5001) == pytest.approx(0.5001)
    assert age.is_stale


def test_it_is_told_once(age):
    age.accept(10.0)
    assert age.look(11.0) == pytest.approx(1.0)
    assert age.deadline_s is None
    assert age.look(12.0) is None
    assert age.is_stale


def test_each_command_counts_anew(age):
    for tenth in range(100, 200):
        assert age.accept(tenth / 10) is None
        assert age.look(tenth / 10 + 0.4) is None
    assert age.look(19.9 + 0.6) == pytest.approx(0.6)


def test_the_command_that_ends_the_silence_tells_how_long_it_was(age):
    age.accept(10.0)
    age.look(10.6)
    assert age.accept(12.5) == pytest.approx(2.5)
    assert not age.is_stale
    assert age.accept(12.6) is None
    assert age.look(13.2) == pytest.approx(0.6)


def test_how_long_none_has_come_is_known_while_the_newest_is_too_old(age):
    assert age.silence_s(9.0) is None
    age.accept(10.0)
    assert age.silence_s(11.0) is None
    age.look(11.0)
    assert age.silence_s(12.0) == pytest.approx(2.0)
    age.accept(12.5)
    assert age.silence_s(13.5) is None


def test_a_command_that_is_late_but_comes_before_anybody_looks_is_in_time(age):
    age.accept(10.0)
    assert age.accept(11.0) is None
    assert age.look(11.4) is None


def test_a_command_that_comes_while_somebody_looks_is_in_time():
    class Overtaken(CommandAge):
        """Another thread's command comes right after the first look at the deadline."""

        is_overtaken = False

        @property
        def deadline_s(self):
            deadline_s = super().deadline_s
            if not self.is_overtaken:
                self.is_overtaken = True
                self.accept(11.0)
            return deadline_s

    age = Overtaken(StalePolicy(max_age_s=0.5, action="zero"))
    age.accept(10.0)
    assert age.look(11.0) is None
    assert not age.is_stale


def test_time_that_is_nobodys_fault_does_not_count(age):
    age.postpone(5.0)
    assert age.deadline_s is None
    age.accept(10.0)
    age.postpone(20.0)
    assert age.look(20.4) is None
    assert age.look(20.6) == pytest.approx(0.6)
    age.postpone(30.0)
    assert age.is_stale
    assert age.accept(31.0) == pytest.approx(11.0)


def test_after_forgetting_nothing_is_counted_until_a_command_comes(age):
    age.accept(10.0)
    age.look(11.0)
    age.forget()
    assert not age.is_stale
    assert age.look(99.0) is None
    assert age.accept(100.0) is None
    assert age.look(100.6) is not None
