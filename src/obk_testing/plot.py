"""Plot the arrays that a test read, with faults and interventions marked.

Plotting needs matplotlib; `is_drawable` is False without it.
"""

import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from obk_cli.record.plot import HEIGHT_IN, MOST_LINES, MOST_NAMED, WIDTH_IN, save_figure
from obk_testing.result import TrialResult
from obk_testing.topic_log import Array

__all__ = ["draw_trial", "is_drawable", "signals_of"]

_MOST_SIGNALS: Final = 6
"""Maximum number of stacked plots; more would be unreadable."""
_ERROR: Final = 40
"""Minimum severity of log entries that are marked."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """Numbers over time."""

    name: str
    t: Array
    """Shape `(n,)` [s]."""
    values: Array
    """Shape `(n, k)`."""
    labels: tuple[str, ...]
    """Labels of the `k` lines."""
    unit: str | None = None


def is_drawable() -> bool:
    """Whether matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def signals_of(result: TrialResult) -> tuple[Signal, ...]:
    """Return what the test read in a trial, or the simulator's positions if it read nothing."""
    keys = [*result.facts.looked_at] or [("qpos",)]
    signals = (_signal(result, key) for key in keys)
    return tuple(signal for signal in signals if signal is not None)[-_MOST_SIGNALS:]


def _signal(result: TrialResult, key: tuple[str, ...]) -> Signal | None:
    """Return the signal for a key of `looked_at`; None if it has no numbers."""
    labels: tuple[str, ...] = ()
    unit: str | None = None
    try:
        match key:
            case ("qpos",):
                name, t, values = "qpos", result.t, result.qpos
                labels = _position_labels(result)
            case ("qvel",):
                name, t, values = "qvel", result.t, result.qvel
            case ("joint", joint):
                name, t, values = f"joint {joint}", result.t, result.joint(joint)
            case (topic, field):
                log = result[topic]
                name, t, values = f"{topic}.{field}", log.t, np.asarray(log[field])
                unit = log.unit(field)
            case _:
                return None
    except LookupError:  # includes keys whose lookup made the test fail
        return None
    if not len(t) or values.dtype.kind not in "fiub":
        return None
    columns = values.reshape(len(t), -1)[:, :MOST_LINES].astype(float)
    if not labels and columns.shape[1] > 1:
        labels = tuple(f"[{number}]" for number in range(columns.shape[1]))
    return Signal(name=name, t=t, values=columns, labels=labels or ("",), unit=unit)


def _position_labels(result: TrialResult) -> tuple[str, ...]:
    assert result.states is not None
    labels = [f"[{number}]" for number in range(result.qpos.shape[1])]
    for joint, place in result.states.joints.items():
        labels[place] = joint
    return tuple(labels[:MOST_LINES])


def draw_trial(result: TrialResult, title: str, path: Path) -> bool:
    """Write a plot as PNG or SVG, depending on the extension; false if there is nothing to plot.

    Raises:
        OSError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    signals = signals_of(result)
    if not signals:
        return False
    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN * len(signals) + 1.0), layout="constrained")
    parts = figure.subplots(len(signals), 1, sharex=True, squeeze=False)
    for part, signal in zip(parts[:, 0], signals, strict=True):
        for column, label in zip(signal.values.T, signal.labels, strict=True):
            part.plot(signal.t, column, linewidth=1.0, label=label)
        name = signal.name if signal.unit is None else f"{signal.name} [{signal.unit}]"
        part.set_ylabel(name, fontsize="small")
        part.grid(visible=True, alpha=0.3)
        _mark(part, result)
        if 1 < len(signal.labels) <= MOST_NAMED:
            part.legend(loc="upper right", fontsize="small")
    parts[-1, 0].set_xlabel("simulated time [s]")
    events = "\n".join(_events(result))
    figure.suptitle(f"{title}\n{events}" if events else title, fontsize="small")
    save_figure(figure, path)
    return True


def _mark(part: Any, result: TrialResult) -> None:
    """Shade interventions, and mark errors that nodes logged."""
    for one in result.facts.interventions:
        end = min(one.t + one.duration, result.duration_s)
        part.axvspan(one.t, end, color="tab:orange", alpha=0.2)
        part.axvline(one.t, color="tab:orange", linewidth=0.8)
    for entry in result.log:
        if entry.severity >= _ERROR:
            part.axvline(entry.time_ns * 1e-9, color="tab:red", linewidth=0.8, linestyle="--")


def _events(result: TrialResult) -> Iterator[str]:
    most = 4
    texts = [f"{one.t:.3f} s: {one.text}" for one in result.facts.interventions]
    texts += [f"fault: {fault.splitlines()[0]}" for fault in result.faults]
    yield from texts[:most]
    if len(texts) > most:
        yield f"and {len(texts) - most} more"
