"""The controls that reach the actuators, and the reports about the others."""

from types import SimpleNamespace

import pytest

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.control import ControlInbox, StampOrder, control_field


class _Time:
    now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def time():
    return _Time()


@pytest.fixture
def inbox(time):
    return ControlInbox(field="u_mujoco", size=2, monotonic_s=time)


def reported(inbox):
    return [report.text for report in inbox.reports()]


def _message(*values):
    return SimpleNamespace(u_mujoco=list(values))


def test_the_latest_control_is_the_one_that_is_applied(inbox):
    assert inbox.newest is None
    assert inbox.offer(_message(1.0, 2.0))
    assert inbox.offer(_message(3.0, 4.0))
    assert inbox.newest.tolist() == [3.0, 4.0]
    assert reported(inbox) == []


def test_a_control_does_not_change_with_its_message(inbox):
    message = _message(1.0, 2.0)
    inbox.offer(message)
    message.u_mujoco[0] = 9.0
    assert inbox.newest.tolist() == [1.0, 2.0]


def test_a_control_that_is_one_number_is_one_for_one_actuator(time):
    inbox = ControlInbox(field="u", size=1, monotonic_s=time)
    assert inbox.offer(SimpleNamespace(u=2.0))
    assert inbox.newest.tolist() == [2.0]


def test_a_control_of_the_wrong_length_is_rejected(inbox):
    inbox.offer(_message(1.0, 2.0))
    assert not inbox.offer(_message(5.0))
    (text,) = reported(inbox)
    assert text.startswith("control rejected: `u_mujoco` has the length 1, ")
    assert text.endswith(" (1x); 1 in total")
    assert inbox.newest.tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("value", "written"),
    [
        (float("nan"), "nan"),
        (float("inf"), "inf"),
        (float("-inf"), "-inf"),
        (1.1e10, "1.1e+10"),
        (-1.1e10, "-1.1e+10"),
    ],
)
def test_a_control_that_is_not_finite_or_huge_is_kept_out(inbox, value, written):
    assert not inbox.offer(_message(0.0, value))
    (text,) = reported(inbox)
    assert f"`u_mujoco[1]` is {written} (1x)" in text
    assert inbox.newest is None


def test_rejections_are_reported_once_per_second_with_their_counts(inbox, time):
    inbox.offer(_message())
    assert len(reported(inbox)) == 1
    for _ in range(500):
        inbox.offer(_message())
    inbox.offer(_message(float("nan"), 0.0))
    inbox.offer(_message(1.0, 2.0))
    assert reported(inbox) == []
    time.now_s += 1.0
    (text,) = reported(inbox)
    assert " (500x); " in text
    assert text.endswith("`u_mujoco[0]` is nan (1x); 502 in total")
    time.now_s += 1.0
    assert reported(inbox) == []


@pytest.fixture
def stamped(time):
    """An inbox that checks stamps; its clock is that of the reports."""
    stamps = StampOrder(lambda: round(time() * 1e9), 0.5)
    return ControlInbox(field="u_mujoco", size=1, monotonic_s=time, stamps=stamps)


def _sent(at_s, value):
    seconds, nanoseconds = divmod(round(at_s * 1e9), 10**9)
    stamp = SimpleNamespace(sec=seconds, nanosec=nanoseconds)
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp), u_mujoco=[value])


def test_a_control_that_is_older_than_the_one_applied_is_kept_out(stamped):
    assert stamped.offer(_sent(99.9, 1.0))
    assert not stamped.offer(_sent(99.8, 2.0))
    assert stamped.newest.tolist() == [1.0]
    (text,) = reported(stamped)
    assert text.startswith("control rejected: ")
    assert stamped.offer(_sent(99.9, 3.0))
    assert stamped.newest.tolist() == [3.0]


def test_a_rejected_control_does_not_make_those_before_it_old(stamped):
    assert not stamped.offer(_sent(99.9, float("nan")))
    assert stamped.offer(_sent(99.8, 1.0))


def test_a_late_control_is_applied_and_reported(stamped):
    assert stamped.offer(_sent(99.6, 1.0))
    assert reported(stamped) == []
    stamped.clear()
    assert stamped.offer(_sent(99.4, 2.0))
    assert stamped.newest.tolist() == [2.0]
    (text,) = reported(stamped)
    assert text.startswith("late control applied: ")


def test_a_control_without_a_stamp_is_neither_late_nor_old(stamped):
    assert stamped.offer(_sent(99.9, 1.0))
    assert stamped.offer(_sent(0, 2.0))
    assert stamped.newest.tolist() == [2.0]
    assert reported(stamped) == []
    assert not stamped.offer(_sent(99.8, 3.0))


def test_after_the_clock_was_set_back_the_next_control_counts(stamped, time):
    assert stamped.offer(_sent(99.9, 1.0))
    time.now_s = 3.0
    assert stamped.offer(_sent(2.9, 2.0))
    assert not stamped.offer(_sent(2.8, 3.0))


def test_after_a_reset_any_stamp_is_a_new_one(stamped):
    assert stamped.offer(_sent(99.9, 1.0))
    stamped.clear()
    assert stamped.offer(_sent(99.8, 2.0))


def test_clearing_forgets_the_control(inbox):
    inbox.offer(_message(1.0, 2.0))
    inbox.clear()
    assert inbox.newest is None


def test_the_field_is_u_mujoco_if_the_message_has_both():
    class Both:
        u = u_mujoco = ()

    class Old:
        u = ()

    assert control_field(Both) == "u_mujoco"
    assert control_field(Old) == "u"


def test_a_message_without_either_field_is_named():
    class VelocityCommand:
        v_x = 0.0

    with pytest.raises(ObeliskConfigError) as caught:
        control_field(VelocityCommand)
    assert "VelocityCommand" in str(caught.value)
