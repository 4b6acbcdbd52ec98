"""Reset random generators in modules, so that every trial starts with the same states.

Modules stay loaded between trials. Without a reset, random numbers that one trial draws from a
generator in a module or class would change the next trial.
"""

import random
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from types import ModuleType
from typing import Any, Final

import numpy as np

__all__ = ["ModuleGenerators"]

_LARGEST_GIVEN: Final = 1 << 64
"""Limit that distinguishes numpy's own 128-bit seeds from seeds in source code."""

Restore = Callable[[Sequence[int]], None]
_known: Final[dict[int, tuple[Any, Restore]]] = {}
"""By `id`: a generator and the function that resets it; one per process, like modules."""


class ModuleGenerators:
    """The generators in the modules that a stack has loaded."""

    def __init__(self, modules: Iterable[str]) -> None:
        """Record their states, unless an earlier stack has already recorded them."""
        self._found = [
            (name, generator)
            for module in sorted(modules)
            for name, generator in _generators_of(sys.modules[module])
        ]
        for _, generator in self._found:
            _known.setdefault(id(generator), (generator, _restoring(generator)))

    def begin_trial(self, seed: int) -> None:
        """Reset the generators; those without their own seed get one derived from the trial's."""
        for name, generator in self._found:
            _, restore = _known[id(generator)]
            restore([seed, *name.encode()])


def _generators_of(module: ModuleType) -> Iterator[tuple[str, Any]]:
    for name, value in list(vars(module).items()):
        if _is_generator(value):
            yield name, value
        elif isinstance(value, type) and value.__module__ == module.__name__:
            for attribute, of_class in list(vars(value).items()):
                if _is_generator(of_class):
                    yield f"{name}.{attribute}", of_class


def _is_generator(value: object) -> bool:
    if isinstance(value, random.Random):
        return not isinstance(value, random.SystemRandom)
    return isinstance(value, np.random.Generator | np.random.RandomState)


def _restoring(generator: Any) -> Restore:
    """Return a function that resets a generator; its argument seeds generators without a seed."""
    if isinstance(generator, random.Random):
        random_state = generator.getstate()
        return lambda _: generator.setstate(random_state)
    if isinstance(generator, np.random.RandomState):
        numpy_state = generator.get_state()
        return lambda _: generator.set_state(numpy_state)
    bits: Any = generator.bit_generator
    entropy = getattr(bits.seed_seq, "entropy", None)
    if isinstance(entropy, int) and entropy >= _LARGEST_GIVEN:

        def reseed(seed: Sequence[int]) -> None:
            bits.state = type(bits)(np.random.SeedSequence(seed)).state

        return reseed
    state = bits.state
    return lambda _: setattr(bits, "state", state)
