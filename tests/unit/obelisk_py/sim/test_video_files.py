"""Videos of known images, read back: times, colors and durations of frames."""

import io

import av
import numpy as np
import pytest
from PIL import Image

from obelisk_py.core.sim.mujoco.viewers.video_files import VIDEO_FILES

WIDTH, HEIGHT = 64, 48
RED, GREEN, BLUE = (200, 30, 40), (20, 180, 60), (30, 60, 210)
FAR = 12
"""Tolerance of colors, because both formats are lossy."""


def picture(left, right):
    """Two colors side by side."""
    pixels = np.empty((HEIGHT, WIDTH, 3), np.uint8)
    pixels[:, : WIDTH // 2], pixels[:, WIDTH // 2 :] = left, right
    return pixels


SHOWN = ((picture(RED, GREEN), 0), (picture(BLUE, GREEN), 1), (picture(BLUE, RED), 5))
"""Images and the frames at which they start; three are missing."""


def video(ending, rate_hz, shown=SHOWN):
    file = io.BytesIO()
    made = VIDEO_FILES[ending](file, (WIDTH, HEIGHT), rate_hz)
    for pixels, number in shown:
        made.show(pixels[::-1][::-1], number)
    made.end()
    file.seek(0)
    return file


def assert_same(seen, wanted):
    assert seen.shape == wanted.shape
    for half in (slice(4, WIDTH // 2 - 4), slice(WIDTH // 2 + 4, -4)):
        off = np.abs(seen[:, half].astype(int) - wanted[:, half]).max()
        assert off <= FAR, off


def test_an_mp4_is_h264_and_shows_each_picture_from_its_frame_on():
    with av.open(video(".mp4", 30)) as read:
        stream = read.streams.video[0]
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert (stream.width, stream.height) == (WIDTH, HEIGHT)
        frames = list(read.decode(stream))
        seconds = float(stream.duration * stream.time_base)
    assert [round(frame.time * 30) for frame in frames] == [0, 1, 5]
    assert seconds == pytest.approx(6 / 30, abs=1e-3)
    for frame, (pixels, _) in zip(frames, SHOWN, strict=True):
        assert_same(frame.to_ndarray(format="rgb24"), pixels)


def test_an_mp4_is_as_long_as_its_content_however_uneven():
    numbers = [0, 1, 12, 26, 41, 54, 68, 85, 106, 123, 141, 154]
    pixels = [picture((20 * n, 0, 255 - 20 * n), GREEN) for n in range(len(numbers))]
    with av.open(video(".mp4", 30, list(zip(pixels, numbers, strict=True)))) as read:
        stream = read.streams.video[0]
        times = [frame.time for frame in read.decode(stream)]
        seconds = float(stream.duration * stream.time_base)
    assert [round(time * 30) for time in times] == numbers
    assert seconds == pytest.approx(155 / 30, abs=1e-3)


def test_an_mp4_declares_its_color_space():
    with av.open(video(".mp4", 30)) as read:
        (frame, *_) = read.decode(video=0)
    assert (frame.colorspace, frame.color_range) == (1, 1)


def test_a_gif_shows_each_picture_from_its_frame_on_and_begins_again():
    with Image.open(video(".gif", 15)) as read:
        assert read.size == (WIDTH, HEIGHT)
        assert read.info["loop"] == 0
        shown, times = [], []
        for number in range(read.n_frames):
            read.seek(number)
            shown.append(np.asarray(read.convert("RGB")))
            times.append(read.info["duration"])
    # 1/15 s, 4/15 s and 1/15 s, with each start rounded to 1/100 s.
    assert times == [70, 260, 70]
    for seen, (pixels, _) in zip(shown, SHOWN, strict=True):
        assert_same(seen, pixels)


def test_times_of_a_gif_add_up():
    pixels = [picture((number, 0, 0), GREEN) for number in range(0, 200, 4)]
    with Image.open(video(".gif", 30, [(one, n) for n, one in enumerate(pixels)])) as read:
        times = []
        for number in range(read.n_frames):
            read.seek(number)
            times.append(read.info["duration"])
    assert sum(times) == pytest.approx(1000 * len(pixels) / 30, abs=10)


def test_a_gif_of_a_static_scene_is_one_long_frame():
    with Image.open(video(".gif", 15, [(picture(RED, GREEN), n) for n in range(30)])) as read:
        assert read.n_frames == 1
        assert read.info["duration"] == 2000


def test_of_a_picture_that_changes_in_part_a_gif_keeps_the_rest():
    small = picture(RED, GREEN)
    small[10:20, 10:20] = BLUE
    whole = video(".gif", 15, [(picture(RED, GREEN), 0)]).getbuffer().nbytes
    both = video(".gif", 15, [(picture(RED, GREEN), 0), (small, 1)])
    assert both.getbuffer().nbytes < 2 * whole
    with Image.open(both) as read:
        read.seek(1)
        assert_same(np.asarray(read.convert("RGB"))[:8], picture(RED, GREEN)[:8])
        assert np.abs(np.asarray(read.convert("RGB"))[15, 15].astype(int) - BLUE).max() <= FAR


def test_a_png_is_identical_to_the_last_picture():
    with Image.open(video(".png", 30)) as read:
        assert read.format == "PNG"
        assert np.array_equal(np.asarray(read), SHOWN[-1][0])
