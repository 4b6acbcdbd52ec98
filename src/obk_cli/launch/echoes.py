"""Tells what a node says of a transition that was asked for here from what others asked for."""

from collections import Counter
from collections.abc import Collection

from obk_cli.launch.events import Answered, Failed, StateSeen

__all__ = ["Echoes"]


class Echoes:
    """The transitions asked for here of which the node has not told by itself yet.

    An answer and what the node tells by itself come on two ways, in either order; so an old message
    must not stand for the newest state. The answer counts, and the other one is the echo.
    """

    def __init__(self) -> None:
        """Expect nothing yet."""
        self._expected: Counter[tuple[str, str]] = Counter()
        self._given_up: dict[tuple[str, str], float] = {}

    def expect(self, node: str, transition: str) -> None:
        """A transition is asked for."""
        self._expected[node, transition] += 1
        self._given_up.pop((node, transition), None)

    def give_up(self, node: str, transition: str, asked: float) -> None:
        """Nobody waits for the answer to what was asked then any more; it may come yet."""
        self._given_up[node, transition] = asked

    def when_asked(self, heard: Answered) -> float | None:
        """When an answer that had been given up was asked for; None: it had not."""
        return self._given_up.pop((heard.node, heard.transition), None)

    def forget(self, nodes: Collection[str]) -> None:
        """What these were asked for is gone with their process."""
        for transition in [known for known in self._expected if known[0] in nodes]:
            del self._expected[transition]
        for transition in [known for known in self._given_up if known[0] in nodes]:
            del self._given_up[transition]

    def is_one(self, heard: StateSeen | Failed) -> bool:
        """Whether a message tells of what was asked here; it is expected no more then."""
        transition = (heard.node, heard.transition)
        if self._expected[transition] == 0:
            return False
        self._expected[transition] -= 1
        return True
