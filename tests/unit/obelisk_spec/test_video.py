"""Settings of a video, valid and invalid, and its status."""

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
def test_a_video_has_the_default_rate_of_its_file_type(ending, rate_hz):
    assert read_video(f"a/out{ending}", "", "", 0) == VideoSettings(
        path=Path(f"a/out{ending}"), camera=None, size=None, rate_hz=rate_hz
    )


def test_every_setting_is_used():
    assert read_video("out.gif", "side", "321x240", 50) == VideoSettings(
        path=Path("out.gif"), camera="side", size=(321, 240), rate_hz=50
    )


@pytest.mark.parametrize(
    ("settings", "value", "expected"),
    [
        (("out.avi", "", "", 0), "`out.avi`", ".mp4, .gif or .png"),
        (("out", "", "", 0), "`out`", ".mp4, .gif or .png"),
        (("out.mp4", "", "", -1), "-1 ", "1 to 240"),
        (("out.gif", "", "", 60), "60 ", "1 to 50"),
        (("out.mp4", "", "640", 0), "`640`", "`640x480`"),
        (("out.mp4", "", "641x479", 0), "641x479", "642x480"),
        (("out.png", "", "8x480", 0), "8x480", "16 to 4096"),
        (("out.png", "", "640x5000", 0), "640x5000", "16 to 4096"),
    ],
)
def test_an_invalid_setting_is_an_error_with_the_expected_values(settings, value, expected):
    with pytest.raises(VideoError) as caught:
        read_video(*settings)
    message = str(caught.value)
    assert value in message
    assert expected in message


@pytest.mark.parametrize("state", ["recording", "finished", "failed"])
def test_a_status_round_trips(state):
    status = VideoStatus(state=state, path="/here/out.mp4", detail="300 frames, 10.0 s")
    assert parse_video(rate_name("/robot", VIDEO_STATUS), dict(video_values(status))) == status


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("robot: timer_video", {"state": "finished", "path": "/here/out.mp4"}),
        ("robot: video", {"state": "lost", "path": "/here/out.mp4"}),
        ("robot: video", {"state": "finished"}),
        ("robot: video", {}),
    ],
)
def test_a_status_about_something_else_is_not_a_video(name, values):
    assert parse_video(name, values) is None
