"""What the robot wants of the process that makes its film, on its way there as an argument."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Self

__all__ = ["FilmOrder"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmOrder:
    """One film."""

    path: str
    """Absolute."""
    camera: int | None
    """Number of the camera; None: a view of the whole model."""
    width: int
    """[pixels]"""
    height: int
    rate_hz: int
    """Frames in a second of simulation time."""

    def to_arguments(self) -> tuple[str, ...]:
        """As the process gets it."""
        return (json.dumps(asdict(self)),)

    @classmethod
    def from_arguments(cls, arguments: Sequence[str]) -> Self:
        """As it was given."""
        (text,) = arguments
        return cls(**json.loads(text))
