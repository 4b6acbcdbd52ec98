"""Random numbers that depend on nothing but the seed, the topic and what they are for.

So noise on one field changes nothing in another, and a run can be had again.
"""

from zlib import crc32

import numpy as np

__all__ = ["Chance", "Dropout"]


class Chance:
    """A stream of random numbers that can be begun anew."""

    def __init__(self, *, seed: int, topic: str, purpose: str) -> None:
        """Begin the stream."""
        self._source = np.random.SeedSequence(
            [seed, crc32(topic.encode()), crc32(purpose.encode())]
        )
        self.numbers = np.random.Generator(np.random.PCG64(self._source))
        """The stream, where it is."""

    def restart(self) -> None:
        """Begin the stream anew."""
        self.numbers = np.random.Generator(np.random.PCG64(self._source))


class Dropout:
    """Decides which messages are not published."""

    def __init__(self, probability: float, chance: Chance) -> None:
        """Decide by `chance`, with a probability from 0 to 1."""
        self._probability = probability
        self._chance = chance

    def strikes(self) -> bool:
        """Whether the next message is lost."""
        return bool(self._chance.numbers.random() < self._probability)

    def restart(self) -> None:
        """Begin the same decisions anew."""
        self._chance.restart()
