"""Settings of a video of a simulated robot: kind of file, size, frame rate.

`read_film` checks what a user wrote and raises `FilmError` with what is expected. No file is read.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

__all__ = ["FILM_RATES", "FilmError", "FilmSettings", "check_film_size", "read_film"]

FILM_RATES: Final[Mapping[str, int]] = MappingProxyType({".mp4": 30, ".gif": 15, ".png": 30})
"""Ending of the file -> frames in a second of simulation time, where nothing else is asked for."""
_HIGHEST_RATES: Final = MappingProxyType({".mp4": 240, ".gif": 50, ".png": 240})
"""A GIF counts hundredths of a second, and browsers slow down frames of a single one."""
_SIZE: Final = re.compile(r"([0-9]{1,5})x([0-9]{1,5})")
_SMALLEST, _LARGEST = 16, 4096
"""Width and height [pixels]."""


class FilmError(ValueError):
    """A film that cannot be made; the message says what can."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmSettings:
    """A film that is asked for."""

    path: Path
    camera: str | None
    """Name of a camera of the model; None: a view of the whole model."""
    size: tuple[int, int] | None
    """Width and height [pixels]; None: the camera's."""
    rate_hz: int
    """Frames in a second of simulation time."""


def read_film(path: str, camera: str, size: str, rate_hz: int) -> FilmSettings:
    """The film that is meant.

    Args:
        path: the file.
        camera: its name; empty for none.
        size: `640x480`; empty for the camera's own.
        rate_hz: 0 for that of the kind of file.

    Raises:
        FilmError: there is no such film.
    """
    ending = Path(path).suffix
    if ending not in FILM_RATES:
        *most, last = FILM_RATES
        raise FilmError(f"`{path}`: expected a file named {', '.join(most)} or {last}")
    if not 0 <= rate_hz <= _HIGHEST_RATES[ending]:
        raise FilmError(
            f"{rate_hz} frames per second; expected 1 to {_HIGHEST_RATES[ending]} for {ending}"
        )
    pixels = None
    if size:
        found = _SIZE.fullmatch(size)
        if found is None:
            raise FilmError(f"the size `{size}`; expected width and height in pixels, `640x480`")
        pixels = int(found[1]), int(found[2])
        check_film_size(ending, pixels)
    return FilmSettings(
        path=Path(path),
        camera=camera or None,
        size=pixels,
        rate_hz=rate_hz or FILM_RATES[ending],
    )


def check_film_size(ending: str, size: tuple[int, int]) -> None:
    """Make sure that a kind of file takes pictures of a size [pixels].

    Raises:
        FilmError: it does not.
    """
    width, height = size
    if not (_SMALLEST <= width <= _LARGEST and _SMALLEST <= height <= _LARGEST):
        raise FilmError(
            f"a picture of {width}x{height}; expected {_SMALLEST} to {_LARGEST} pixels each way"
        )
    if ending == ".mp4" and (width % 2 or height % 2):
        # H.264 keeps one colour for two by two pixels.
        raise FilmError(
            f"a picture of {width}x{height}; .mp4 wants even numbers, "
            f"{width + width % 2}x{height + height % 2}"
        )
