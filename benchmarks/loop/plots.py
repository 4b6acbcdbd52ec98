"""Plot the CPU use of the loop over what a part of the suite varies: `loop_<part>.svg`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from benchmarks.loop.cases import CONTESTANTS, LAYOUTS, cases_of
from benchmarks.loop.report import Row

__all__ = ["CURVES", "draw_curve"]

CURVES = {
    "nodes": ("nodes", "nodes at 100 Hz"),
    "rate": ("rate_hz", "rate of each node's timer [Hz]"),
    "size": ("joints", "joints in each message, 1 kHz"),
}
"""Part -> the field that it varies, and the label of the axis."""
# The same data gives the same file.
STYLE: Any = {"svg.hashsalt": "obelisk", "svg.fonttype": "none"}


def draw_curve(folder: Path, part: str, rows: Sequence[Row]) -> Path:
    """Plot one part and return the file.

    Args:
        folder: the output folder.
        part: a key of `CURVES`.
        rows: the results; missing cases are left out of the plot.
    """
    field, label = CURVES[part]
    found = {row.case: row for row in rows if row.figures}
    layouts = [layout for layout in LAYOUTS if any(row.case.layout == layout for row in rows)]
    figure = Figure(figsize=(9, 4), layout="constrained")
    panels = figure.subplots(1, len(layouts), sharey=True, squeeze=False)[0]
    for axes, layout in zip(panels, layouts, strict=True):
        for index, contestant in enumerate(CONTESTANTS):
            cases = [c for c in cases_of([part], [contestant], [layout]) if c in found]
            if not cases:
                continue
            costs = [found[case].figures["cpu_percent"] for case in cases]
            values = [getattr(case, field) for case in cases]
            axes.plot(
                values, [c.median for c in costs], marker="o", color=f"C{index}", label=contestant
            )
            axes.fill_between(
                values, [c.min for c in costs], [c.max for c in costs], color=f"C{index}", alpha=0.2
            )
        axes.set(title=layout, xlabel=label, ylim=(0, None))
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("CPU, all processes [% of a core]")
    figure.axes[0].legend(fontsize="small")
    path = folder / f"loop_{part}.svg"
    with mpl.rc_context(STYLE):
        figure.savefig(path, metadata={"Date": None})
    return path
