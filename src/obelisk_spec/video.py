"""Check the settings for a video of a simulated robot, and exchange its status.

`read_video` returns `VideoSettings`, or raises a `VideoError` with the expected values.
`VideoStatus` is converted to and from keys and values of a `diagnostic_msgs/DiagnosticStatus`. No
file is opened.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal, cast, get_args

__all__ = [
    "VIDEO_STATUS",
    "VideoError",
    "VideoSettings",
    "VideoStatus",
    "check_video_size",
    "parse_video",
    "read_video",
    "video_values",
]

VIDEO_RATES: Final[Mapping[str, int]] = MappingProxyType({".mp4": 30, ".gif": 15, ".png": 30})
"""File suffix -> default frames per second of simulated time."""
_HIGHEST_RATES: Final = MappingProxyType({".mp4": 240, ".gif": 50, ".png": 240})
"""A GIF counts time in 1/100 s, and browsers slow down frames of 1/100 s."""
_SIZE: Final = re.compile(r"([0-9]{1,5})x([0-9]{1,5})")
_SMALLEST, _LARGEST = 16, 4096
"""Limits of width and height [pixels]."""
VIDEO_STATUS: Final = "video"
"""Name of the status on /diagnostics, after the node's name: `robot: video`."""
_STATE, _PATH, _DETAIL = "state", "path", "detail"

VideoState = Literal["recording", "finished", "failed"]


class VideoError(ValueError):
    """A video cannot be recorded; the message states what is expected."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoSettings:
    """A requested video."""

    path: Path
    camera: str | None
    """Name of a camera in the model; None for a view of the whole model."""
    size: tuple[int, int] | None
    """Width and height [pixels]; None for the camera's own size."""
    rate_hz: int
    """Frames per second of simulated time."""


def read_video(path: str, camera: str, size: str, rate_hz: int) -> VideoSettings:
    """Check the settings of a requested video.

    Args:
        path: path of the video file.
        camera: name of a camera; empty for a view of the whole model.
        size: `640x480`; empty for the camera's own size.
        rate_hz: frames per second; 0 for the default of the file type.

    Raises:
        VideoError: a value is invalid.
    """
    ending = Path(path).suffix
    if ending not in VIDEO_RATES:
        *most, last = VIDEO_RATES
        raise VideoError(f"`{path}`: expected a file name that ends in {', '.join(most)} or {last}")
    if not 0 <= rate_hz <= _HIGHEST_RATES[ending]:
        raise VideoError(
            f"{rate_hz} frames per second; expected 1 to {_HIGHEST_RATES[ending]} for {ending}"
        )
    pixels = None
    if size:
        found = _SIZE.fullmatch(size)
        if found is None:
            raise VideoError(f"the size `{size}`; expected width and height in pixels, `640x480`")
        pixels = int(found[1]), int(found[2])
        check_video_size(ending, pixels)
    return VideoSettings(
        path=Path(path),
        camera=camera or None,
        size=pixels,
        rate_hz=rate_hz or VIDEO_RATES[ending],
    )


def check_video_size(ending: str, size: tuple[int, int]) -> None:
    """Check that a file type supports a size [pixels].

    Raises:
        VideoError: it does not support the size.
    """
    width, height = size
    if not (_SMALLEST <= width <= _LARGEST and _SMALLEST <= height <= _LARGEST):
        raise VideoError(
            f"an image of {width}x{height}; expected {_SMALLEST} to {_LARGEST} pixels each way"
        )
    if ending == ".mp4" and (width % 2 or height % 2):
        # H.264 stores one color per 2 by 2 pixels.
        raise VideoError(
            f"an image of {width}x{height}; .mp4 needs even numbers, "
            f"{width + width % 2}x{height + height % 2}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoStatus:
    """State and path of a robot's video."""

    state: VideoState
    path: str
    """Absolute path: the requested one while recording, the final one of a finished video."""
    detail: str = ""
    """Frames, length and dropped frames of a finished video, or the reason of a failure."""

    def __str__(self) -> str:
        match self.state:
            case "recording":
                return f"recording a video to {self.path}"
            case "finished":
                return f"video: {self.path}, {self.detail}"
            case "failed":
                return self.detail


def video_values(status: VideoStatus) -> tuple[tuple[str, str], ...]:
    """Return keys and values of the status that reports a video."""
    return ((_STATE, status.state), (_PATH, status.path), (_DETAIL, status.detail))


def parse_video(name: str, values: Mapping[str, str]) -> VideoStatus | None:
    """Parse the video in a status; None if the status reports something else.

    Args:
        name: name of the status, as formatted by `runtime_protocol.rate_name`.
        values: values of the status, by key.
    """
    state, path = values.get(_STATE, ""), values.get(_PATH, "")
    if not name.endswith(f": {VIDEO_STATUS}") or state not in get_args(VideoState) or not path:
        return None
    return VideoStatus(state=cast(VideoState, state), path=path, detail=values.get(_DETAIL, ""))
