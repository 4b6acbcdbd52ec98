"""Drop, delay and disturb the messages of a topic for some time, by the seed of a trial."""

import functools
import re
from collections import Counter
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from obelisk_py.core.lockstep.scheduler import NS_PER_S, Scheduler
from obelisk_py.core.lockstep.topics import Topic
from obk_testing.topic_log import nested_class

__all__ = ["Disturbances"]

__tracebackhide__ = True
"""Makes pytest show the line in the test instead of lines in this module."""

_FLOATS: Final = re.compile(r"(sequence<)?(float|double)(, \d+)?>?(\[\d+\])?")
"""Types of the fields to which noise can be added, as rclpy names them."""


class Disturbances:
    """The disturbances of a trial; each one acts on messages published from now on."""

    def __init__(self, scheduler: Scheduler, seed: int) -> None:
        """Create it without disturbances.

        Args:
            scheduler: the trial's scheduler.
            seed: the trial's seed.
        """
        self._scheduler = scheduler
        self._seed = seed
        self._uses: Counter[str] = Counter()
        """Use of random numbers -> how many generators it has."""

    def drop(self, topic: Topic, share: float, duration: float) -> None:
        """Drop a fraction of the messages, 0 to 1, during a time [s]."""
        numbers, during = self._numbers(f"drop {topic.label}"), self._during(duration)
        topic.rules.append(
            lambda now_ns, _: None if during(now_ns) and numbers.random() < share else 0
        )

    def delay(self, topic: Topic, seconds: float, duration: float) -> None:
        """Add a latency [s] to the messages during a time [s]."""
        during, delay_ns = self._during(duration), round(seconds * NS_PER_S)
        topic.rules.append(lambda now_ns, _: delay_ns if during(now_ns) else 0)

    def noise(self, topic: Topic, field: str, sigma: float, duration: float) -> None:
        """Add noise to a field; for arguments and errors see `StackTrial.noise`."""
        paths = _paths_of_floats(topic, field)
        numbers, during = self._numbers(f"noise {topic.label} {field}"), self._during(duration)

        def disturb(now_ns: int, message: Any) -> None:
            if not during(now_ns):
                return
            for *outer, name in paths:
                inner = functools.reduce(getattr, outer, message)
                value = getattr(inner, name)
                if isinstance(value, float):
                    setattr(inner, name, value + float(numbers.normal(0.0, sigma)))
                else:
                    noisy = np.asarray(value, float) + numbers.normal(0.0, sigma, len(value))
                    setattr(inner, name, noisy.tolist())

        topic.filters.append(disturb)

    def _during(self, duration: float) -> Callable[[int], bool]:
        start_ns = self._scheduler.now_ns
        end_ns = start_ns + duration * NS_PER_S
        return lambda now_ns: start_ns <= now_ns < end_ns

    def _numbers(self, use: str) -> np.random.Generator:
        """Random numbers of the seed; those of another call are independent."""
        self._uses[use] += 1
        return np.random.default_rng([self._seed, self._uses[use], *use.encode()])


def _paths_of_floats(topic: Topic, field: str) -> tuple[tuple[str, ...], ...]:
    """Return the paths of the numbers in a field, as names from the outermost message inwards.

    Raises:
        LookupError: the field does not exist, or is no number and no message of numbers only.
    """
    names, kind = tuple(field.split(".")), ""
    message_class: type[Any] | None = topic.message_class
    for name in names:
        fields = message_class.get_fields_and_field_types() if message_class else {}
        if name not in fields:
            where = f"; {kind or topic.label} has {', '.join(fields)}" if fields else ""
            raise LookupError(f"{topic.label} has no field `{field}`{where}")
        kind = fields[name]
        message_class = nested_class(kind)
    if _FLOATS.fullmatch(kind):
        return (names,)
    inner = message_class.get_fields_and_field_types() if message_class else {}
    if inner and all(map(_FLOATS.fullmatch, inner.values())):
        return tuple((*names, name) for name in inner)
    raise LookupError(
        f"{topic.label}: the field `{field}` is a {kind}; noise needs a float or double, or a "
        "message that contains only these"
    )
