"""The thread that wakes when the newest command is too old."""

import threading
import time

from obelisk_py.core.command_age import CommandAge, StalePolicy
from obelisk_py.core.lookout import Lookout

from ...waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests


def _lookout(max_age_s):
    age = CommandAge(StalePolicy(max_age_s=max_age_s, action="zero"))
    told = threading.Event()

    def look():
        if age.look(time.monotonic()) is not None:
            told.set()

    return age, Lookout(lambda: age.deadline_s, look), told


def test_it_tells_of_a_command_that_none_follows():
    age, lookout, told = _lookout(0.01)
    lookout.start()
    age.accept(time.monotonic())
    lookout.wake()
    assert told.wait(DEADLINE_S)
    assert lookout.stop(DEADLINE_S)


def test_it_tells_again_after_commands_have_come_again():
    age, lookout, told = _lookout(0.01)
    age.accept(time.monotonic())
    lookout.start()
    assert told.wait(DEADLINE_S)
    told.clear()
    age.accept(time.monotonic())
    lookout.wake()
    assert told.wait(DEADLINE_S)
    assert lookout.stop(DEADLINE_S)


def test_it_ends_at_once_although_its_deadline_is_far():
    age, lookout, told = _lookout(1e9)
    age.accept(time.monotonic())
    lookout.start()
    assert lookout.stop(DEADLINE_S)
    assert not told.is_set()


def test_it_ends_although_no_command_ever_came():
    _, lookout, told = _lookout(0.01)
    lookout.start()
    assert lookout.stop(DEADLINE_S)
    assert not told.is_set()
