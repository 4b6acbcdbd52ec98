"""Decide the random order of faults, so that every kind occurs. Pure."""

import random
from collections.abc import Iterator
from typing import Final, Literal

__all__ = ["Trouble", "first_deck", "plan"]

Trouble = Literal["transitions", "kill", "freeze", "observer", "observers_leave", "reload"]
DECK: Final[tuple[Trouble, ...]] = (
    *("transitions",) * 5,
    *("kill",) * 2,
    "freeze",
    *("observer",) * 3,
    *("observers_leave",) * 3,
)
DECKS_OF_A_LAUNCH: Final = 4
"""Reloads are rare, because slow leaks show only in processes that live long."""


def first_deck(draw: random.Random, *, is_frozen: bool = True) -> list[Trouble]:
    """Each fault once; an observer starts before all observers are stopped."""
    deck = list(dict.fromkeys((*DECK, "reload")))
    deck.remove("observers_leave")
    if not is_frozen:
        deck.remove("freeze")
    draw.shuffle(deck)
    return [*deck, "observers_leave"]


def plan(draw: random.Random, *, is_frozen: bool = True) -> Iterator[Trouble]:
    """The first deck, followed by an endless sequence of others.

    Args:
        draw: the same seed gives the same plan.
        is_frozen: whether nodes are stopped by SIGSTOP.
    """
    yield from first_deck(draw, is_frozen=is_frozen)
    deck = [trouble for trouble in DECK if is_frozen or trouble != "freeze"]
    while True:
        for _ in range(DECKS_OF_A_LAUNCH):
            draw.shuffle(deck)
            yield from deck
        yield "reload"
