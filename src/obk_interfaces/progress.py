"""What a build tells about its advance, for a bar or a log line."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

__all__ = ["Progress", "ProgressCallback", "Step"]

Step: TypeAlias = Literal["unchanged", "generate", "compile", "link", "install"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """A step of the build has advanced: `done` of `total` pieces of the step are finished."""

    step: Step
    subject: str
    done: int
    total: int


ProgressCallback: TypeAlias = Callable[[Progress], None]
