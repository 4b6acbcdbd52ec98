"""A finding about a `sim` block, as a value: the tool gives it a place, the simulator logs it."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["SimFault", "SimPath"]

SimPath = tuple[str | int, ...]
"""Keys and indexes into the sim block; one that starts with `params` goes into the node's
parameters instead."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimFault:
    """One finding; `str()` is the line that a log shows."""

    code: str
    severity: Literal["error", "warning", "info"]
    path: SimPath
    message: str
    help: str | None = None
    points_at: Literal["key", "value"] = "value"
    """Whether the finding is about the last key of `path` or about what it holds."""
    meant: str | None = None
    """The name to write there instead; only where it is certain."""
    element: tuple[str, str] | None = None
    """Kind (`sensor`, `geom`, `site`, `key`, `joint`) and name of the model element meant."""

    def __str__(self) -> str:
        place = "".join(
            f"[{step}]" if isinstance(step, int) else f".{step}" for step in self.path
        ).lstrip(".")
        line = f"{self.severity}[{self.code}]: {place}: {self.message}"
        return f"{line} ({self.help})" if self.help else line
