"""Format the table in the project's README that compares the loop with rclpy's executors."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from benchmarks.loop.cases import CONTESTANTS, LAYOUTS, Case

__all__ = ["BEGIN", "END", "peers_table", "with_table"]

BEGIN: Final = "<!-- written by make bench PART=summary -->"
END: Final = "<!-- end of the generated table -->"
BARE: Final = "obelisk executor"
"""Plain nodes on the library's executor; left out because users do not run them."""


def peers_table(loop: Mapping[str, Any]) -> Iterator[str]:
    """The lines of a Markdown table, one contestant per line.

    Args:
        loop: the content of `loop.json`.
    """
    rows = {tuple(row["case"].values()): row for row in loop["cases"] if row["runs"]}
    separate, composed = "CPU per tick, one process per node", "CPU per tick, one process for all"
    yield f"| | {separate} | slowest node | {composed} | slowest node |"
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
    """Replace the table between the markers of a document.

    Raises:
        ValueError: the markers are missing.
    """
    start, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    return f"{text[:start]}\n\n{table}\n\n{text[end:]}"
