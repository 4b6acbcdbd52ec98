"""Write a result: the outcome, and separately the samples over time and their plot."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

__all__ = ["RESULTS", "draw_picture", "keep_result"]

ROOT: Final = Path(__file__).resolve().parents[2]
RESULTS: Final = ROOT / "benchmarks" / "results"
RAW: Final = ROOT / "build" / "benchmarks"
RAW_KEYS: Final = ("samples", "judged", "troubles")

KEYS = ("rss_mb", "handles", "threads", "shm_files")
# The same data gives the same file.
STYLE: Any = {"svg.hashsalt": "obelisk", "svg.fonttype": "none"}


def keep_result(result: Mapping[str, Any], path: Path) -> None:
    """Write the outcome, the samples behind it, and their plot.

    The samples are too large to commit: if the outcome goes to `benchmarks/results`, the samples
    and the plot go to `build/benchmarks`.

    Args:
        result: with `samples`, `judged` and `troubles`.
        path: the file of the outcome, `*.json`; its folder is created if it does not exist.
    """
    raw_folder = RAW if path.parent == RESULTS else path.parent
    outcome = {key: value for key, value in result.items() if key not in RAW_KEYS}
    raw = {key: result[key] for key in RAW_KEYS}
    _write(path, outcome)
    _write(raw_folder / f"{path.stem}_samples.json", raw)
    try:
        draw_picture(result, raw_folder / f"{path.stem}.svg")
    except ImportError:
        print("skipped the plot: install obk with its `plot` extra", file=sys.stderr)


def _write(path: Path, content: Mapping[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def draw_picture(result: Mapping[str, Any], path: Path) -> None:
    """Plot the samples of a soak.

    Args:
        result: with `samples` and `troubles`.
        path: the file to write.

    Raises:
        ImportError: matplotlib is not installed.
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
