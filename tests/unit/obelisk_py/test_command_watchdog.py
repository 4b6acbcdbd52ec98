"""The age of commands, the thread that monitors it, and its log messages."""

import threading
import time

import pytest

from obelisk_py.core.command_watchdog import (
    ONLY_REJECTIONS,
    SILENCE_GRACE_S,
    SILENCE_PERIOD_S,
    CommandAge,
    RejectionLog,
    SilenceLog,
    StalePolicy,
    WatchdogThread,
)

from ...waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests


@pytest.fixture
def age():
    return CommandAge(StalePolicy(max_age_s=0.5, action="zero"))


def test_nothing_is_counted_before_the_first_command(age):
    assert age.deadline_s is None
    assert age.look(1e9) is None
    assert not age.is_stale


def test_a_command_is_too_old_right_after_its_deadline_but_not_at_it(age):
    age.accept(10.0)
    assert age.deadline_s == 10.5
    assert age.look(10.5) is None
    assert age.look(10.5001) == pytest.approx(0.5001)
    assert age.is_stale


def test_it_is_reported_once(age):
    age.accept(10.0)
    assert age.look(11.0) == pytest.approx(1.0)
    assert age.deadline_s is None
    assert age.look(12.0) is None
    assert age.is_stale


def test_each_command_counts_again(age):
    for tenth in range(100, 200):
        assert age.accept(tenth / 10) is None
        assert age.look(tenth / 10 + 0.4) is None
    assert age.look(19.9 + 0.6) == pytest.approx(0.6)


def test_the_command_that_ends_the_silence_reports_its_duration(age):
    age.accept(10.0)
    age.look(10.6)
    assert age.accept(12.5) == pytest.approx(2.5)
    assert not age.is_stale
    assert age.accept(12.6) is None
    assert age.look(13.2) == pytest.approx(0.6)


def test_the_duration_without_a_command_is_known_while_the_latest_is_too_old(age):
    assert age.silence_s(9.0) is None
    age.accept(10.0)
    assert age.silence_s(11.0) is None
    age.look(11.0)
    assert age.silence_s(12.0) == pytest.approx(2.0)
    age.accept(12.5)
    assert age.silence_s(13.5) is None


def test_a_late_command_that_arrives_before_the_check_is_in_time(age):
    age.accept(10.0)
    assert age.accept(11.0) is None
    assert age.look(11.4) is None


def test_a_command_that_arrives_during_the_check_is_in_time():
    class Overtaken(CommandAge):
        """Another thread's command arrives right after the first check of the deadline."""

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


def test_a_pause_does_not_count(age):
    age.postpone(5.0)
    assert age.deadline_s is None
    age.accept(10.0)
    age.postpone(20.0)
    assert age.look(20.4) is None
    assert age.look(20.6) == pytest.approx(0.6)
    age.postpone(30.0)
    assert age.is_stale
    assert age.accept(31.0) == pytest.approx(11.0)


def test_after_forgetting_nothing_is_counted_until_a_command_arrives(age):
    age.accept(10.0)
    age.look(11.0)
    age.forget()
    assert not age.is_stale
    assert age.look(99.0) is None
    assert age.accept(100.0) is None
    assert age.look(100.6) is not None


def _watchdog(max_age_s):
    age = CommandAge(StalePolicy(max_age_s=max_age_s, action="zero"))
    reported = threading.Event()

    def check():
        if age.look(time.monotonic()) is not None:
            reported.set()

    return age, WatchdogThread(lambda: age.deadline_s, check), reported


def test_it_reports_a_command_that_no_other_follows():
    age, watchdog, reported = _watchdog(0.01)
    watchdog.start()
    age.accept(time.monotonic())
    watchdog.wake()
    assert reported.wait(DEADLINE_S)
    assert watchdog.stop(DEADLINE_S)


def test_it_reports_again_after_commands_have_returned():
    age, watchdog, reported = _watchdog(0.01)
    age.accept(time.monotonic())
    watchdog.start()
    assert reported.wait(DEADLINE_S)
    reported.clear()
    age.accept(time.monotonic())
    watchdog.wake()
    assert reported.wait(DEADLINE_S)
    assert watchdog.stop(DEADLINE_S)


def test_it_ends_immediately_although_its_deadline_is_far():
    age, watchdog, reported = _watchdog(1e9)
    age.accept(time.monotonic())
    watchdog.start()
    assert watchdog.stop(DEADLINE_S)
    assert not reported.is_set()


def test_it_ends_although_no_command_ever_came():
    _, watchdog, reported = _watchdog(0.01)
    watchdog.start()
    assert watchdog.stop(DEADLINE_S)
    assert not reported.is_set()


@pytest.fixture
def silences():
    return SilenceLog()


def test_a_silence_is_reported_once_a_grace_is_over(silences):
    assert silences.due_s is None
    silences.begin(100.0)
    assert silences.due_s == 100.0 + SILENCE_GRACE_S
    assert silences.report(100.5, 0.55) == "no command for 0.550 s"
    assert silences.due_s is None


def test_the_return_of_commands_is_reported_only_after_their_absence_was(silences):
    silences.begin(100.0)
    assert not silences.end(0.2)
    assert silences.report(100.5, None) == "commands stopped 1 time, for up to 0.200 s"
    silences.begin(200.0)
    silences.report(200.5, 0.55)
    assert silences.end(3.0)
    silences.begin(300.0)
    assert not silences.end(0.3)


def test_silences_now_and_then_are_counted_and_reported_each_ten_seconds(silences):
    reported = []
    for tenth in range(1000, 1300, 2):
        now_s = tenth / 10
        if silences.due_s is not None and now_s >= silences.due_s:
            reported.append((now_s, silences.report(now_s, None)))
        silences.begin(now_s)
        silences.end(0.1)
    assert [now_s for now_s, _ in reported] == pytest.approx([100.6, 110.6, 120.6])
    assert reported[1][1] == "commands stopped 50 times, for up to 0.100 s"


def test_a_lasting_silence_is_reported_as_such_among_others(silences):
    silences.begin(100.0)
    silences.report(100.5, 0.55)
    silences.end(0.6)
    for second in (101.0, 102.0):
        silences.begin(second)
    assert silences.due_s == 100.5 + SILENCE_PERIOD_S
    text = silences.report(110.5, 8.55)
    assert text == "commands stopped 2 times, most recently for 8.550 s"


def test_forgotten_entries_are_not_reported(silences):
    silences.begin(100.0)
    silences.forget()
    assert silences.due_s is None
    silences.begin(200.0)
    assert silences.report(201.0, 1.05) == "no command for 1.050 s"


class World:
    """RejectionLog at one rate, and its reports."""

    def __init__(self):
        self.now_s = 50.0
        self.rejections = RejectionLog("control rejected", lambda: self.now_s, ONLY_REJECTIONS)

    def reject_for(self, seconds, *, accept_each=None):
        """Reports, as (time, report), while a message is rejected each tenth of a second."""
        reported = []
        for count in range(1, round(seconds * 10) + 1):
            self.rejections.add("`u[0]` is nan")
            report = self.rejections.report()
            if report is not None:
                reported.append((round(self.now_s, 1), report))
            if accept_each is not None and count % accept_each == 0:
                self.rejections.accept()
            self.now_s += 0.1
        return reported


@pytest.fixture
def world():
    return World()


def test_only_rejections_are_an_error_after_a_second_and_then_reported_rarely(world):
    first, *errors = world.reject_for(25.0)
    assert first[0] == 50.0
    assert first[1].text == "control rejected: `u[0]` is nan (1x); 1 in total"
    assert not first[1].is_lasting
    assert [time_s for time_s, _ in errors] == pytest.approx([51.0, 61.0, 71.0], abs=0.11)
    assert all(report.is_lasting for _, report in errors)
    assert errors[0][1].text.startswith("control rejected: `u[0]` is nan (1")
    assert "in total; no valid message has been received for 1." in errors[0][1].text
    assert errors[0][1].text.endswith("`obk topic echo` shows what the controller sends")


def test_rejections_last_until_a_message_is_accepted(world):
    world.reject_for(0.5)
    assert world.rejections.lasting() is None
    world.reject_for(2.0)
    lasting = world.rejections.lasting()
    assert (round(lasting.seconds, 1), lasting.reason) == (2.4, "`u[0]` is nan")
    world.rejections.accept()
    assert world.rejections.lasting() is None


def test_one_rejection_and_then_silence_does_not_last(world):
    world.rejections.add("`u[0]` is nan")
    world.now_s += 60.0
    assert world.rejections.lasting() is None


def test_accepted_messages_in_between_leave_it_a_warning(world):
    reported = world.reject_for(5.0, accept_each=9)
    assert len(reported) == 5
    assert not any(report.is_lasting for _, report in reported)


def test_without_an_end_message_nothing_is_an_error():
    now_s = 0.0
    late = RejectionLog("late control applied", lambda: now_s)
    late.add("its stamp is old")
    now_s = 100.0
    assert not late.report().is_lasting


def test_the_last_report_counts_everything_without_waiting():
    rejections = RejectionLog("control rejected", lambda: 0.0)
    rejections.add("nan")
    assert rejections.report().text == "control rejected: nan (1x); 1 in total"
    rejections.add("nan")
    assert rejections.report() is None
    assert rejections.report(is_last=True).text == "control rejected: nan (1x); 2 in total"
    assert rejections.report(is_last=True) is None


def test_reasons_that_differ_each_time_make_no_endless_line():
    rejections = RejectionLog("control rejected", lambda: 0.0)
    for value in range(1000):
        rejections.add(f"`u[0]` is {value}")
    text = rejections.report().text
    assert text.startswith("control rejected: `u[0]` is 0 (1x); `u[0]` is 1 (1x); ")
    assert text.endswith("`u[0]` is 7 (1x); other reasons (992x); 1000 in total")
    rejections.add("`u[0]` is 9")
    assert rejections.report() is None
