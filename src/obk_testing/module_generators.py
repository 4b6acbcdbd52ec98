"""Random generators that modules keep: a trial begins with them as the first one did.

Modules stay loaded from trial to trial, so what one trial draws from a generator of a module or of
a class would change the next one.
"""

import random
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from types import ModuleType
from typing import Any, Final

import numpy as np

__all__ = ["ModuleGenerators"]

_LARGEST_GIVEN: Final = 1 << 64
"""Seeds that numpy draws itself have 128 bits; seeds in source have fewer."""

Restore = Callable[[Sequence[int]], None]
_known: Final[dict[int, tuple[Any, Restore]]] = {}
"""By identity: a generator, and what sets it back; one for the process, as modules are."""


class ModuleGenerators:
    """The generators of the modules that a stack has loaded."""

    def __init__(self, modules: Iterable[str]) -> None:
        """Note their states, unless an earlier stack has them too."""
        self._found = [
            (name, generator)
            for module in sorted(modules)
            for name, generator in _generators_of(sys.modules[module])
        ]
        for _, generator in self._found:
            _known.setdefault(id(generator), (generator, _restoring(generator)))

    def begin_trial(self, seed: int) -> None:
        """Set them back; those without a seed of their own get one from the trial's."""
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
    """What sets a generator back; its argument is the seed of one that has none of its own."""
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
