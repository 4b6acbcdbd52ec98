"""Rates and delays of topics in a line each, and as objects."""

from dataclasses import asdict
from typing import Any, Final

from obk_cli.introspect.latency import Delay
from obk_cli.introspect.rates import TopicRate

__all__ = ["delay_data", "delay_text", "rate_data", "rate_text"]


SILENT_S: Final = 1.0
"""Without a message, and for twice as long as ever in the window, a topic counts as silent [s]."""


def rate_text(rate: TopicRate) -> str:
    """What was measured of a topic, for a person."""
    age_s = rate.age_s or 0.0
    if rate.rate_hz is None:
        few = ("no message yet", "one message")
        return few[rate.count] if rate.count < len(few) else f"no message for {age_s:.1f} s"
    parts = [f"{rate.rate_hz:8.2f} Hz"]
    for name, value in (
        ("min", rate.min_s),
        ("max", rate.max_s),
        ("std dev", rate.std_dev_s),
        ("jitter", rate.jitter_s),
    ):
        parts.append(f"{name} {_ms(value or 0.0)}")
    parts.append("lost unknown" if rate.lost is None else f"lost {rate.lost}")
    parts.append(f"{_amount(rate.bytes_per_s or 0.0)}/s")
    parts.append(f"{rate.seen} messages in {rate.window_s:.2f} s")
    if age_s > max(SILENT_S, 2 * (rate.max_s or 0.0)):
        parts.append(f"none for {age_s:.1f} s")
    return "  ".join(parts)


def rate_data(topic: str, rate: TopicRate) -> dict[str, Any]:
    """What was measured of a topic, for a program."""
    return {"topic": topic, **asdict(rate)}


def delay_text(delay: Delay) -> str:
    """The delays of a topic, for a person."""
    clock = f"the stamps are of another clock, {delay.pace:.3g} times as fast"
    zero = f"  (above the quickest: {clock})" if delay.is_relative else ""
    return (
        f"mean {_ms(delay.mean_s)}  min {_ms(delay.min_s)}  max {_ms(delay.max_s)}  "
        f"std dev {_ms(delay.std_dev_s)}  {delay.seen} messages{zero}"
    )


def delay_data(topic: str, delay: Delay) -> dict[str, Any]:
    """The delays of a topic, for a program."""
    return {"topic": topic, **asdict(delay)}


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.3f} ms"


def _amount(count: float) -> str:
    for unit, size in (("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count:.0f} B"
