"""Frames of a video: simulation time is video time, despite drops and resets."""

from hypothesis import given
from hypothesis import strategies as st

from obelisk_py.core.sim.mujoco.step_times import SampleTimes
from obelisk_py.core.sim.mujoco.viewers.video_process import FrameCounter


def taken(rate_hz, times):
    numbers = FrameCounter(rate_hz)
    return [numbers.take(time_s) for time_s in times], numbers


def test_a_state_is_shown_at_its_time():
    assert taken(10, [0.0, 0.1, 0.2, 0.3])[0] == [0, 1, 2, 3]


def test_frames_without_a_state_are_dropped_and_the_video_keeps_time():
    found, numbers = taken(10, [0.0, 0.1, 0.5])
    assert found == [0, 1, 5]
    assert numbers.count == 6


def test_a_second_state_of_one_frame_is_not_shown():
    assert taken(10, [0.0, 0.1, 0.15])[0] == [0, 1, None]


def test_after_a_reset_the_video_continues():
    assert taken(10, [0.0, 0.1, 0.2, 0.0, 0.1])[0] == [0, 1, 2, 3, 4]


def test_a_video_starts_with_its_first_state_at_any_time():
    assert taken(10, [7.3, 7.4])[0] == [0, 1]


@given(rate_hz=st.integers(1, 240), steps_per_s=st.integers(1, 10_000))
def test_no_frame_is_missing_if_every_sample_arrives(rate_hz, steps_per_s):
    """Samples occur a part of a step after the multiple of their period."""
    rate_hz = min(rate_hz, steps_per_s)
    step_s = 1 / steps_per_s
    samples = SampleTimes(period_s=1 / rate_hz, step_s=step_s)
    steps = [0]
    for _ in range(50):
        steps.append(samples.next_step)
        samples.pass_step(samples.next_step)
    assert taken(rate_hz, [step * step_s for step in steps])[0] == list(range(51))
