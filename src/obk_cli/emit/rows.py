"""How high in a picture each slot stands: near what it is joined to, inside its device's band.

Layers and heights in, the middles' heights out [px, downwards].
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

from obk_cli.emit.layers import Slot
from obk_cli.emit.placement import place_apart

__all__ = ["Borders", "band_borders", "place_rows"]

Borders = tuple[float, float]
"""Top and bottom of a band [px]."""
Rows = Sequence[Sequence[Slot]]
Heights = Mapping[Slot, float]

_GAP = 18.0
"""Between two boxes [px]."""
_HEADING = 34.0
"""Above the boxes of a band [px]."""
_FOOT = 18.0
"""Below them [px]."""
_SWEEPS = 8


def band_borders(layers: Rows, heights: Heights, count: int) -> tuple[Borders, ...]:
    """Each band as high as what its fullest layer needs."""
    borders: list[Borders] = []
    top = 0.0
    for band in range(count):
        stacks = (_in_band(layer, band) for layer in layers)
        needed = max((_stack_height(stack, heights) for stack in stacks), default=0.0)
        borders.append((top, top + _HEADING + needed + _FOOT))
        top = borders[-1][1] + _GAP
    return tuple(borders)


def place_rows(layers: Rows, heights: Heights, borders: Sequence[Borders]) -> dict[Slot, float]:
    """The height of each slot's middle."""
    middles = {
        slot: sum(borders[slot.band]) / 2 + (_HEADING - _FOOT) / 2
        for layer in layers
        for slot in layer
    }
    for sweep in range(_SWEEPS + 1):
        for layer in layers if sweep % 2 == 0 else reversed(layers):
            for band, (top, bottom) in enumerate(borders):
                stack = _in_band(layer, band)
                if stack:
                    wishes = [_wish(slot, middles) if sweep else middles[slot] for slot in stack]
                    least = top + _HEADING + heights[stack[0]] / 2
                    most = bottom - _FOOT - heights[stack[-1]] / 2
                    places = place_apart(wishes, _gaps(stack, heights), least, most)
                    middles.update(zip(stack, places, strict=True))
    return middles


def _wish(slot: Slot, middles: Mapping[Slot, float]) -> float:
    beside = (*slot.before, *slot.after)
    return sum(middles[other] for other in beside) / len(beside) if beside else middles[slot]


def _in_band(layer: Iterable[Slot], band: int) -> list[Slot]:
    return [slot for slot in layer if slot.band == band]


def _gaps(stack: Sequence[Slot], heights: Heights) -> list[float]:
    """Least distances between middles."""
    return [(heights[a] + heights[b]) / 2 + _GAP for a, b in pairwise(stack)]


def _stack_height(stack: Sequence[Slot], heights: Heights) -> float:
    if not stack:
        return 0.0
    return (heights[stack[0]] + heights[stack[-1]]) / 2 + sum(_gaps(stack, heights))
