"""Which controls reach the actuators, and what is said about the others."""

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


def told(inbox):
    return [report.text for report in inbox.reports()]


def _message(*values):
    return SimpleNamespace(u_mujoco=list(values))


def test_the_newest_control_is_the_one_that_is_applied(inbox):
    assert inbox.newest is None
    assert inbox.offer(_message(1.0, 2.0))
    assert inbox.offer(_message(3.0, 4.0))
    assert inbox.newest.tolist() == [3.0, 4.0]
    assert told(inbox) == []


def test_a_control_does_not_change_with_the_message_that_brought_it(inbox):
    message = _message(1.0, 2.0)
    inbox.offer(message)
    message.u_mujoco[0] = 9.0
    assert inbox.newest.tolist() == [1.0, 2.0]


def test_a_control_that_is_one_number_is_one_for_one_actuator(time):
    inbox = ControlInbox(field="u", size=1, monotonic_s=time)
    assert inbox.offer(SimpleNamespace(u=2.0))
    assert inbox.newest.tolist() == [2.0]


def test_a_control_of_the_wrong_length_is_kept_out(inbox):
    inbox.offer(_message(1.0, 2.0))
    assert not inbox.offer(_message(5.0))
    assert told(inbox) == [
        "control refused: `u_mujoco` has the length 1, the model takes 2 (1x); 1 since the start"
    ]
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
    assert told(inbox) == [f"control refused: `u_mujoco[1]` is {written} (1x); 1 since the start"]
    assert inbox.newest is None


def test_refusals_are_told_once_per_second_with_their_counts(inbox, time):
    inbox.offer(_message())
    assert len(told(inbox)) == 1
    for _ in range(500):
        inbox.offer(_message())
    inbox.offer(_message(float("nan"), 0.0))
    inbox.offer(_message(1.0, 2.0))
    assert told(inbox) == []
    time.now_s += 1.0
    assert told(inbox) == [
        "control refused: `u_mujoco` has the length 0, the model takes 2 (500x); "
        "`u_mujoco[0]` is nan (1x); 502 since the start"
    ]
    time.now_s += 1.0
    assert told(inbox) == []


@pytest.fixture
def stamped(time):
    """An inbox that looks at stamps; its clock is that of the reports."""
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
    assert told(stamped) == [
        "control refused: it is older than the one applied, by their stamps (1x); 1 since the start"
    ]
    assert stamped.offer(_sent(99.9, 3.0))
    assert stamped.newest.tolist() == [3.0]


def test_a_refused_control_does_not_make_those_before_it_old(stamped):
    assert not stamped.offer(_sent(99.9, float("nan")))
    assert stamped.offer(_sent(99.8, 1.0))


def test_a_late_control_is_applied_and_told(stamped):
    assert stamped.offer(_sent(99.6, 1.0))
    assert told(stamped) == []
    stamped.clear()
    assert stamped.offer(_sent(99.4, 2.0))
    assert stamped.newest.tolist() == [2.0]
    assert told(stamped) == [
        "control applied though late: its stamp is more than 0.5 s old (1x); 1 since the start"
    ]


def test_a_control_without_a_stamp_is_neither_late_nor_old(stamped):
    assert stamped.offer(_sent(99.9, 1.0))
    assert stamped.offer(_sent(0, 2.0))
    assert stamped.newest.tolist() == [2.0]
    assert told(stamped) == []
    assert not stamped.offer(_sent(99.8, 3.0))


def test_where_the_clock_was_set_back_the_next_control_counts(stamped, time):
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


def test_the_field_is_u_mujoco_where_the_message_has_both():
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
    assert str(caught.value) == (
        "the control message VelocityCommand has neither a field `u_mujoco` nor `u`, "
        "so the simulator cannot read what to write to the actuators"
    )
