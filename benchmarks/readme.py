"""The loop's figures beside rclpy's executors, as the project's README shows them."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from benchmarks.loop.cases import CONTESTANTS, LAYOUTS, Case

__all__ = ["BEGIN", "END", "peers_table", "with_table"]

BEGIN: Final = "<!-- written by make bench PART=summary -->"
END: Final = "<!-- end of what is written -->"
BARE: Final = "obelisk executor"
"""Plain nodes on the library's executor: between the peers and what users have, so left out."""


def peers_table(loop: Mapping[str, Any]) -> Iterator[str]:
    """The lines of a Markdown table: a contestant in each.

    Args:
        loop: what `loop.json` holds.
    """
    rows = {tuple(row["case"].values()): row for row in loop["cases"] if row["runs"]}
    yield "| | CPU of a tick, a process each | slowest node | composed in one | slowest node |"
    yield "|---|---|---|---|---|"
    for contestant in CONTESTANTS:
        if contestant == BARE:
            continue
        cells = [contestant]
        for layout in LAYOUTS:
            case = Case(contestant=contestant, layout=layout)
            row = rows.get(tuple(case.as_dict().values()))
            cells += _cells(row) if row else ["failed", ""]
        yield f"| {' | '.join(cells)} |"


def _cells(row: Mapping[str, Any]) -> list[str]:
    ratio, rate = row["ratios"].get("cpu_per_tick_us"), row["figures"]["rate_hz"]
    return [_ratio(ratio["median"]) if ratio else "", f"{rate['median']:.0f} Hz"]


def _ratio(value: float) -> str:
    return f"{value:.0f}" if value >= 10 else f"{value:.2f}"


def with_table(text: str, table: str) -> str:
    """A document with a table between its marks, in the place of the one before.

    Raises:
        ValueError: the marks are not there.
    """
    begin, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    return f"{text[:begin]}\n\n{table}\n\n{text[end:]}"
