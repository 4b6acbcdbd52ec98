"""Is there a screen for viewers? Facts in, findings out."""

from collections.abc import Iterator
from dataclasses import dataclass

from obk_cli.doctor.finding import Finding, note, ok

__all__ = ["DisplayFacts", "judge_display"]


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplayFacts:
    """What DISPLAY and WAYLAND_DISPLAY name, and whether anybody answers there."""

    names: tuple[str, ...]
    """Such as `DISPLAY=:0`; empty where neither is set."""
    fault: str
    """Why the first of them does not answer; empty: it does, or there is none."""
    is_ssh: bool


def judge_display(facts: DisplayFacts) -> Iterator[Finding]:
    """Whether a window can be opened."""
    if not facts.names:
        cure = "ssh -X ..." if facts.is_ssh else "export MUJOCO_GL=egl"
        yield note("no display: stacks run without windows", cure)
    elif facts.fault:
        yield note(
            f"{facts.names[0]} does not answer: {facts.fault}", "unset DISPLAY WAYLAND_DISPLAY"
        )
    else:
        yield ok(f"display {facts.names[0]} answers")
