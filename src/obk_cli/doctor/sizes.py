"""Amounts of memory and disk space, for a person."""

from typing import Final

__all__ = ["GIB", "MIB", "told_bytes"]

MIB: Final = 1024**2
GIB: Final = 1024**3


def told_bytes(count: int) -> str:
    """Such as `64 MiB` or `1.5 GiB`."""
    if count < GIB:
        return f"{count / MIB:.0f} MiB"
    return f"{count / GIB:.1f} GiB"
