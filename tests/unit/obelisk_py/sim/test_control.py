"""Which controls reach the actuators, and what is said about the others."""

from types import SimpleNamespace

import pytest

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.control import ControlInbox, control_field


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


def _message(*values):
    return SimpleNamespace(u_mujoco=list(values))


def test_the_newest_control_is_the_one_that_is_applied(inbox):
    assert inbox.newest is None
    assert inbox.offer(_message(1.0, 2.0)) is None
    assert inbox.offer(_message(3.0, 4.0)) is None
    assert inbox.newest.tolist() == [3.0, 4.0]


def test_a_control_does_not_change_with_the_message_that_brought_it(inbox):
    message = _message(1.0, 2.0)
    inbox.offer(message)
    message.u_mujoco[0] = 9.0
    assert inbox.newest.tolist() == [1.0, 2.0]


def test_a_control_of_the_wrong_length_is_kept_out(inbox):
    inbox.offer(_message(1.0, 2.0))
    assert inbox.offer(_message(5.0)) == (
        "control refused: `u_mujoco` has the length 1, the model takes 2 (1x); 1 since the start"
    )
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
    assert inbox.offer(_message(0.0, value)) == (
        f"control refused: `u_mujoco[1]` is {written} (1x); 1 since the start"
    )
    assert inbox.newest is None


def test_refusals_are_told_once_per_second_with_their_counts(inbox, time):
    assert inbox.offer(_message()) is not None
    for _ in range(500):
        assert inbox.offer(_message()) is None
    assert inbox.offer(_message(float("nan"), 0.0)) is None
    assert inbox.report() is None
    time.now_s += 1.0
    assert inbox.report() == (
        "control refused: `u_mujoco` has the length 0, the model takes 2 (500x); "
        "`u_mujoco[0]` is nan (1x); 502 since the start"
    )
    time.now_s += 1.0
    assert inbox.report() is None


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
