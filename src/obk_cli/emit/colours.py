"""The colour of each section in every picture."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

__all__ = ["SECTION_COLOURS", "Colour"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Colour:
    """A pair that belongs together."""

    light: str
    """For areas that carry text."""
    dark: str
    """For lines and headings, legible on white and on `light`."""


SECTION_COLOURS: Final[Mapping[str, Colour]] = MappingProxyType(
    {
        "robot": Colour(light="#e6f4ea", dark="#1a7f37"),
        "sensing": Colour(light="#e0f4f7", dark="#0b7285"),
        "estimation": Colour(light="#ddf0ff", dark="#0969da"),
        "control": Colour(light="#fff1e0", dark="#b35900"),
        "viz": Colour(light="#f3ebff", dark="#7a44c9"),
        "joystick": Colour(light="#ffe9ef", dark="#bf3989"),
    }
)
