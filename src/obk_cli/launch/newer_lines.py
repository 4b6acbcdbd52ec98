"""What a process wrote since its last lines were looked at. Pure."""

from collections.abc import Sequence

__all__ = ["newer_lines"]


def newer_lines(before: Sequence[str], after: Sequence[str]) -> tuple[str, ...]:
    """The lines that came since.

    Args:
        before: the last lines then.
        after: the last lines now; the oldest ones of those before may have fallen out.
    """
    kept = next(n for n in range(len(before), -1, -1) if after[:n] == before[len(before) - n :])
    return tuple(after[kept:])
