"""Films of a simulated robot: the settings that a user wrote, and the status that a robot reports.

In: words and numbers. Out: `FilmSettings`, or a `FilmError` whose sentence says what is expected;
`FilmStatus` to and from the keys and values of a `diagnostic_msgs/DiagnosticStatus`. Opens no file.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal, cast, get_args

__all__ = [
    "FILM_RATES",
    "FILM_STATUS",
    "FilmError",
    "FilmSettings",
    "FilmState",
    "FilmStatus",
    "check_film_size",
    "film_values",
    "parse_film",
    "read_film",
]

FILM_RATES: Final[Mapping[str, int]] = MappingProxyType({".mp4": 30, ".gif": 15, ".png": 30})
"""Ending of the file -> frames in a second of simulation time, where nothing else is asked for."""
_HIGHEST_RATES: Final = MappingProxyType({".mp4": 240, ".gif": 50, ".png": 240})
"""A GIF counts hundredths of a second, and browsers slow down frames of a single one."""
_SIZE: Final = re.compile(r"([0-9]{1,5})x([0-9]{1,5})")
_SMALLEST, _LARGEST = 16, 4096
"""Width and height [pixels]."""
FILM_STATUS: Final = "film"
"""Name of the status behind that of the node: `robot: film`."""
_STATE, _PATH, _DETAIL = "state", "path", "detail"

FilmState = Literal["recording", "finished", "failed"]


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


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmStatus:
    """How far the film of a robot is, and where."""

    state: FilmState
    path: str
    """Absolute. While recording the requested one; a finished film may be beside it."""
    detail: str = ""
    """Frames, length and dropped frames of a finished film; the reason of a failed one."""

    def __str__(self) -> str:
        match self.state:
            case "recording":
                return f"a film goes to {self.path}"
            case "finished":
                return f"film: {self.path}, {self.detail}"
            case "failed":
                return self.detail


def film_values(status: FilmStatus) -> tuple[tuple[str, str], ...]:
    """Keys and values of a status."""
    return ((_STATE, status.state), (_PATH, status.path), (_DETAIL, status.detail))


def parse_film(name: str, values: Mapping[str, str]) -> FilmStatus | None:
    """The film that a status is about; None if it is about something else.

    Args:
        name: of the status, as `rates.rate_name` makes it.
        values: of the status, by key.
    """
    state, path = values.get(_STATE, ""), values.get(_PATH, "")
    if not name.endswith(f": {FILM_STATUS}") or state not in get_args(FilmState) or not path:
        return None
    return FilmStatus(state=cast(FilmState, state), path=path, detail=values.get(_DETAIL, ""))
