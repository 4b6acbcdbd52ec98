"""Where things that stand above one another go, if each has a place that it would like best."""

from collections.abc import Sequence

__all__ = ["place_apart"]


def place_apart(
    wishes: Sequence[float], gaps: Sequence[float], least: float, most: float
) -> list[float]:
    """The places nearest to the wishes (least squares) that keep order and distance.

    Args:
        wishes: where each would like to be, in the order in which they stand.
        gaps: least distance between each and the next, one fewer than wishes.
        least: no place is below.
        most: no place is above; there must be room for all gaps.
    """
    offsets = [0.0]
    for gap in gaps:
        offsets.append(offsets[-1] + gap)
    blocks: list[tuple[float, int]] = []  # mean wish, how many share it
    for wish, offset in zip(wishes, offsets, strict=True):
        mean, count = wish - offset, 1
        # Whoever wants to be above the one before shares a place with it.
        while blocks and blocks[-1][0] > mean:
            earlier, size = blocks.pop()
            mean = (mean * count + earlier * size) / (count + size)
            count += size
        blocks.append((mean, count))
    highest = max(least, most - offsets[-1])
    places = [min(max(mean, least), highest) for mean, count in blocks for _ in range(count)]
    return [place + offset for place, offset in zip(places, offsets, strict=True)]
