"""Noise, dropout and delay of a sensor group, typed.

In: the mapping of a group that has no findings. Out: a frozen `Disturbances`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["Amount", "Disturbances", "FieldNoise", "typed_disturbances"]

Amount = float | tuple[float, ...]
"""One number for all elements of a field, or one for each axis; in the field's own unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldNoise:
    """Noise of one field: normally distributed around a bias."""

    sigma: Amount
    bias: Amount


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbances:
    """How a group's messages differ from what the simulation knows."""

    noise: Mapping[str, FieldNoise]
    """Field -> its noise."""
    dropout: float
    """Probability that a message is not published."""
    delay_s: float
    """Simulation time from the sample to its message [s]."""
    seed: int


def typed_disturbances(group: Mapping[str, Any]) -> Disturbances:
    """The values of a sensor group that has no findings."""
    noise = {
        field: FieldNoise(sigma=_amount(given.get("sigma")), bias=_amount(given.get("bias")))
        for field, given in (group.get("noise") or {}).items()
    }
    return Disturbances(
        noise=noise,
        dropout=float(group.get("dropout") or 0.0),
        delay_s=float(group.get("delay") or 0.0),
        seed=group.get("seed") or 0,
    )


def _amount(value: Any) -> Amount:
    if isinstance(value, list | tuple):
        return tuple(float(each) for each in value)
    return float(value or 0.0)
