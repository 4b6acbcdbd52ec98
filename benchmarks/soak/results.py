"""Keeps a result: its numbers as JSON, and memory, handles, threads and shared files over time."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

__all__ = ["draw_picture", "keep_result"]

KEYS = ("rss_mb", "handles", "threads", "shm_files")
# The same figures give the same file.
STYLE: Any = {"svg.hashsalt": "obelisk", "svg.fonttype": "none"}


def keep_result(result: Mapping[str, Any], path: Path) -> None:
    """Write the numbers, and where matplotlib is installed the picture beside them.

    Args:
        result: with `samples` and `troubles`.
        path: of the numbers, `*.json`; its folder is made where it is not there.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    try:
        draw_picture(result, path.with_suffix(".svg"))
    except ImportError:
        print("no picture: install obk with its `plot` extra", file=sys.stderr)


def draw_picture(result: Mapping[str, Any], path: Path) -> None:
    """Draw what a soak came to.

    Args:
        result: with `samples` and `troubles`.
        path: where it goes.

    Raises:
        ImportError: there is no matplotlib.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 9), layout="constrained")
    panels = figure.subplots(len(KEYS), 1, sharex=True)
    for axes, key in zip(panels, KEYS, strict=True):
        shown = [one for one in result["samples"] if key in one]
        for who in dict.fromkeys(one["who"] for one in shown):
            own = [one for one in shown if one["who"] == who]
            axes.plot([one["time_s"] for one in own], [one[key] for one in own], ".", label=who)
        for trouble in result["troubles"]:
            axes.axvline(trouble["time_s"], color="0.85", linewidth=0.7, zorder=0)
        axes.set(ylabel=key.replace("_", " "), ylim=(0, None))
    panels[0].legend(fontsize="small")
    panels[-1].set_xlabel("time [s]")
    with mpl.rc_context(STYLE):
        figure.savefig(path, metadata={"Date": None})
