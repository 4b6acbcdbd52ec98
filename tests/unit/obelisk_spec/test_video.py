"""What a film may be, and what is said of those that cannot be."""

from pathlib import Path

import pytest

from obelisk_spec.runtime_protocol import rate_name
from obelisk_spec.video import (
    VIDEO_STATUS,
    VideoError,
    VideoSettings,
    VideoStatus,
    parse_video,
    read_video,
    video_values,
)


@pytest.mark.parametrize(("ending", "rate_hz"), [(".mp4", 30), (".gif", 15), (".png", 30)])
def test_a_film_has_the_rate_of_its_kind(ending, rate_hz):
    assert read_video(f"a/out{ending}", "", "", 0) == VideoSettings(
        path=Path(f"a/out{ending}"), camera=None, size=None, rate_hz=rate_hz
    )


def test_all_may_be_chosen():
    assert read_video("out.gif", "side", "321x240", 50) == VideoSettings(
        path=Path("out.gif"), camera="side", size=(321, 240), rate_hz=50
    )


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("out.avi", "", "", 0), "`out.avi`: expected a file named .mp4, .gif or .png"),
        (("out", "", "", 0), "`out`: expected a file named .mp4, .gif or .png"),
        (("out.mp4", "", "", -1), "-1 frames per second; expected 1 to 240 for .mp4"),
        (("out.gif", "", "", 60), "60 frames per second; expected 1 to 50 for .gif"),
        (
            ("out.mp4", "", "640", 0),
            "the size `640`; expected width and height in pixels, `640x480`",
        ),
        (
            ("out.mp4", "", "641x479", 0),
            "a picture of 641x479; .mp4 wants even numbers, 642x480",
        ),
        (
            ("out.png", "", "8x480", 0),
            "a picture of 8x480; expected 16 to 4096 pixels each way",
        ),
        (
            ("out.png", "", "640x5000", 0),
            "a picture of 640x5000; expected 16 to 4096 pixels each way",
        ),
    ],
)
def test_a_film_that_cannot_be_is_told_with_what_can(words, sentence):
    with pytest.raises(VideoError) as caught:
        read_video(*words)
    assert str(caught.value) == sentence


@pytest.mark.parametrize("state", ["recording", "finished", "failed"])
def test_a_status_is_read_as_it_was_written(state):
    status = VideoStatus(state=state, path="/here/out.mp4", detail="300 frames, 10.0 s")
    assert parse_video(rate_name("/robot", VIDEO_STATUS), dict(video_values(status))) == status


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("robot: timer_film", {"state": "finished", "path": "/here/out.mp4"}),
        ("robot: film", {"state": "lost", "path": "/here/out.mp4"}),
        ("robot: film", {"state": "finished"}),
        ("robot: film", {}),
    ],
)
def test_a_status_about_something_else_is_no_film(name, values):
    assert parse_video(name, values) is None
