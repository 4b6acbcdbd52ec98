"""How much of a topic was recorded, and how much was lost on the way."""

from typing import Final

__all__ = ["DROPS", "Tally"]

DROPS: Final = "obelisk_drops"
"""The metadata record in which a recording tells how many messages were lost, by topic."""


class Tally:
    """Counts the messages of one topic and the gaps in their publisher's numbers."""

    __slots__ = ("_last", "count", "dropped")

    def __init__(self) -> None:
        """Begin with none; what was published before the first one is not missed."""
        self.count = 0
        self.dropped = 0
        self._last = 0

    def take(self, sequence: int, publishers: int) -> None:
        """Count a message.

        Args:
            sequence: its number among those of its publisher, from 1.
            publishers: how many there are; the numbers of several mix and tell nothing.
        """
        self.count += 1
        # A publisher that was started again begins anew.
        if self._last and publishers == 1 and sequence > self._last:
            self.dropped += sequence - self._last - 1
        self._last = sequence
