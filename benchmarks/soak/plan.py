"""What is done to the stack in which order: by chance, and nothing left out. Pure."""

import random
from collections.abc import Iterator
from typing import Final, Literal

__all__ = ["Trouble", "first_deck", "plan"]

Trouble = Literal["transitions", "kill", "freeze", "onlooker", "onlookers_leave", "reload"]
DECK: Final[tuple[Trouble, ...]] = (
    *("transitions",) * 5,
    *("kill",) * 2,
    "freeze",
    *("onlooker",) * 3,
    *("onlookers_leave",) * 3,
)
DECKS_OF_A_LAUNCH: Final = 4
"""A reload is rare, as what grows slowly is seen in processes that live long."""


def first_deck(draw: random.Random, *, is_frozen: bool = True) -> list[Trouble]:
    """Each trouble once; an onlooker comes before all are sent away."""
    deck = list(dict.fromkeys((*DECK, "reload")))
    deck.remove("onlookers_leave")
    if not is_frozen:
        deck.remove("freeze")
    draw.shuffle(deck)
    return [*deck, "onlookers_leave"]


def plan(draw: random.Random, *, is_frozen: bool = True) -> Iterator[Trouble]:
    """The first deck, then others without end.

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
