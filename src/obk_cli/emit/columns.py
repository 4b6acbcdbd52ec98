"""Where in a picture each layer begins and ends, and where between them the ways back run.

Layers and widths in, coordinates out [px, to the right].
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from obk_cli.emit.layers import Return, Slot

__all__ = ["TRACK", "Columns", "place_columns"]

TRACK = 12.0
"""Between two lines that run side by side [px]."""
_GUTTER = 50.0
"""Between two layers, at least [px]."""
_CLEAR = 22.0
"""Between a box and the nearest line that passes it [px]; an arrow's head goes in between."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """Coordinates of layers and of the ways back."""

    lefts: tuple[float, ...]
    """By layer."""
    rights: tuple[float, ...]
    width: float
    """Of everything, from 0."""
    exits: Mapping[Slot, float]
    """Topic -> where its way back goes down."""
    entries: Mapping[tuple[Slot, int], float]
    """Topic and layer -> where its way back comes up left of that layer."""


def place_columns(
    layers: Sequence[Iterable[Slot]], widths: Mapping[Slot, float], returns: Sequence[Return]
) -> Columns:
    """Place the layers; `returns` stand from the innermost to the outermost."""
    outs = [_unique(r.topic for r in returns if r.topic.layer == g - 1) for g in _gutters(layers)]
    ins = [_unique(r.topic for r in returns if r.node.layer == g) for g in _gutters(layers)]
    lefts: list[float] = []
    rights: list[float] = []
    exits: dict[Slot, float] = {}
    entries: dict[tuple[Slot, int], float] = {}
    edge = 0.0
    for gutter in _gutters(layers):
        is_outside = gutter in (0, len(layers))
        tracks = len(outs[gutter]) + len(ins[gutter])
        room = _CLEAR * 2 + tracks * TRACK
        space = (room if tracks else _CLEAR) if is_outside else max(_GUTTER, room)
        exits.update((t, edge + _CLEAR + i * TRACK) for i, t in enumerate(outs[gutter]))
        edge += space
        entries.update(
            ((topic, gutter), edge - _CLEAR - i * TRACK) for i, topic in enumerate(ins[gutter])
        )
        if gutter < len(layers):
            lefts.append(edge)
            edge += max(widths[slot] for slot in layers[gutter])
            rights.append(edge)
    return Columns(
        lefts=tuple(lefts), rights=tuple(rights), width=edge, exits=exits, entries=entries
    )


def _gutters(layers: Sequence[Iterable[Slot]]) -> range:
    """The spaces left of each layer, and the one right of the last."""
    return range(len(layers) + 1)


def _unique(topics: Iterable[Slot]) -> list[Slot]:
    return list(dict.fromkeys(topics))
