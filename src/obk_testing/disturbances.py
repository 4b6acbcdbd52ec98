"""Drop, delay and disturb the messages of a topic for some time, by the seed of a trial."""

import re
from collections import Counter
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from obelisk_py.core.lockstep.scheduler import NS_PER_S, Scheduler
from obelisk_py.core.lockstep.topics import Topic

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
        fields = topic.message_class.get_fields_and_field_types()
        if field not in fields:
            raise LookupError(f"{topic.label} has no field `{field}`; it has {', '.join(fields)}")
        if not _FLOATS.fullmatch(fields[field]):
            raise LookupError(
                f"{topic.label}: the field `{field}` is a {fields[field]}; noise needs a float or "
                "double"
            )
        numbers, during = self._numbers(f"noise {topic.label} {field}"), self._during(duration)

        def disturb(now_ns: int, message: Any) -> None:
            if during(now_ns):
                value = getattr(message, field)
                if isinstance(value, float):
                    setattr(message, field, value + float(numbers.normal(0.0, sigma)))
                else:
                    noisy = np.asarray(value, float) + numbers.normal(0.0, sigma, len(value))
                    setattr(message, field, noisy.tolist())

        topic.filters.append(disturb)

    def _during(self, duration: float) -> Callable[[int], bool]:
        start_ns = self._scheduler.now_ns
        end_ns = start_ns + duration * NS_PER_S
        return lambda now_ns: start_ns <= now_ns < end_ns

    def _numbers(self, use: str) -> np.random.Generator:
        """Random numbers of the seed; those of another call are independent."""
        self._uses[use] += 1
        return np.random.default_rng([self._seed, self._uses[use], *use.encode()])
