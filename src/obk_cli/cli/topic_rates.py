"""`obk topic hz TOPIC...` and `obk topic delay TOPIC`: measure message rates and latencies."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from obk_cli.cli.complete import complete_topics
from obk_cli.cli.options import (
    TIMEOUT_S,
    DomainOption,
    FormatOption,
    TimeoutOption,
    TopicArgument,
    graph_target,
    require_positive,
    wants_json,
    with_types,
)
from obk_cli.errors import CommandFailedError

__all__ = ["delay_text", "rate_text"]

if TYPE_CHECKING:
    from obk_cli.introspect.target import GraphTarget
    from obk_cli.ros.meters import Delay, TopicRate


HZ_EXAMPLE = "Example: obk topic hz est ctrl --duration 5"
DELAY_EXAMPLE = "Example: obk topic delay est --duration 5"
REPORT_S: Final = 1.0
"""Time between two reports [s]."""
POLL_S: Final = 0.001
"""Polling period; short compared with the measured latencies [s]."""

DurationOption = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", help="Measure for this long [s] and print one report."),
]


def hz(
    topics: Annotated[
        list[str],
        typer.Argument(
            metavar="TOPIC...",
            help="Topic names, or suffixes of them.",
            autocompletion=complete_topics,
        ),
    ],
    window: Annotated[
        float, typer.Option(metavar="SECONDS", help="Compute statistics over this many seconds.")
    ] = 10.0,
    duration: DurationOption = None,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
    format: FormatOption = "text",
) -> None:
    """Measure the message rate of topics; report it every second.

    Rates are computed from the times at which the middleware received the messages. min, max and
    std dev refer to the interval between two messages. Jitter is the p99 deviation of intervals
    from their mean. Losses are gaps in the publisher's sequence numbers, and are unknown if there
    are several publishers. The command ends on Ctrl-C or after --duration. Exit code 1 if no
    message is received within --timeout.
    """
    is_json = wants_json(format)
    require_positive("--window", window, "a number of seconds")
    require_positive("--duration", duration, "a number of seconds")
    target = graph_target(domain, timeout)
    measured = _measure_rates(
        with_types(target), topics, window, duration, timeout, is_json=is_json
    )
    if duration is not None:
        _print_rates(measured, is_json=is_json)
        _require_messages(measured, duration, duration)


def _measure_rates(
    target: "GraphTarget",
    topics: Sequence[str],
    window_s: float,
    duration_s: float | None,
    timeout_s: float,
    *,
    is_json: bool,
) -> "Mapping[str, TopicRate]":
    """Measure rates; without a duration, report them every second until Ctrl-C."""
    from obk_cli.introspect.resolve import find_topic, the_type
    from obk_cli.ros.meters import RosMeter
    from obk_cli.ros.participant import open_participant
    from obk_cli.ros.types import raw_type

    with open_participant(target.environment, target.modules(topics)) as participant:
        meter = RosMeter(participant, duration_s or window_s)
        for topic in topics:
            seen = find_topic(participant, target, topic, timeout_s)
            msg_type = the_type("topic", seen.name, seen.published_types)
            hashes = (end.type_hash for end in seen.publishers)
            meter.add(seen.name, msg_type, raw_type(msg_type, hashes))
        with _report_on_interrupt(lambda: _print_rates(meter.rates(), is_json=is_json)):
            start = reported = time.monotonic()
            while duration_s is None or time.monotonic() < start + duration_s:
                meter.turn()
                if duration_s is None and time.monotonic() > reported + REPORT_S:
                    reported = time.monotonic()
                    _print_rates(meter.rates(), is_json=is_json)
                    _require_messages(meter.rates(), reported - start, timeout_s)
        return meter.rates()


def delay(
    topic: TopicArgument,
    window: Annotated[
        int, typer.Option(min=1, help="Compute statistics over this many messages.")
    ] = 10_000,
    duration: DurationOption = None,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
    format: FormatOption = "text",
) -> None:
    """Measure the latency of messages from the stamps in their headers.

    Latency is the time from the stamp to the receipt by the middleware on this host. For simulated
    stamps it is in simulated time, taken from /clock. If the stamps come from another clock and
    there is no /clock, latency is relative to the fastest message.
    """
    is_json = wants_json(format)
    require_positive("--duration", duration, "a number of seconds")
    target = with_types(graph_target(domain, timeout))
    measured = _measure_delay(target, topic, window, duration, timeout, is_json=is_json)
    if duration is not None:
        _print_delay(*measured, duration, duration, is_json=is_json)


def _measure_delay(
    target: "GraphTarget",
    topic: str,
    window: int,
    duration_s: float | None,
    timeout_s: float,
    *,
    is_json: bool,
) -> "tuple[str, Delay | None, int]":
    """Measure latencies; without a duration, report them every second until Ctrl-C."""
    from obk_cli.introspect.resolve import find_topic, the_type
    from obk_cli.ros.meters import DelayMeter, is_of_other_clock, stamp_getter
    from obk_cli.ros.participant import open_participant
    from obk_cli.ros.raw_subscription import arrived
    from obk_cli.ros.simulated_clock import SimulatedClock, subscribe_to_clock
    from obk_cli.ros.types import fields_of, find_type, short_type

    needs = ("rclpy.serialization", *target.modules([topic]))
    with open_participant(target.environment, needs) as participant:
        seen = find_topic(participant, target, topic, timeout_s)
        msg_type = the_type("topic", seen.name, seen.published_types)
        python_type = find_type(msg_type)
        stamp = stamp_getter(short_type(msg_type), fields_of)
        raw = participant.subscribe(seen.name, msg_type, python_type)
        meter, clock, clock_raw = DelayMeter(window), SimulatedClock(), None
        start = reported = time.monotonic()

        def report(passed_s: float) -> None:
            found = (seen.name, meter.delay(), meter.unstamped)
            _print_delay(*found, passed_s, timeout_s, is_json=is_json)

        with _report_on_interrupt(lambda: report(0.0)):
            while duration_s is None or time.monotonic() < start + duration_s:
                if clock_raw is not None:
                    clock.take_waiting(clock_raw)
                for received_ns, message in arrived(raw):
                    stamp_ns = stamp(message)
                    meter.take(received_ns, stamp_ns, clock.at(received_ns))
                    # Subscribe only if needed: a simulator publishes /clock while it has
                    # subscribers.
                    if clock_raw is None and stamp_ns and is_of_other_clock(received_ns, stamp_ns):
                        clock_raw = subscribe_to_clock(participant)
                if duration_s is None and time.monotonic() > reported + REPORT_S:
                    reported = time.monotonic()
                    report(reported - start)
                time.sleep(POLL_S)
        return seen.name, meter.delay(), meter.unstamped


@contextmanager
def _report_on_interrupt(report: Callable[[], None]) -> Iterator[None]:
    """Print a final report on Ctrl-C."""
    try:
        yield
    except KeyboardInterrupt:
        report()
        raise


def _print_rates(rates: "Mapping[str, TopicRate]", *, is_json: bool) -> None:
    from obk_cli.introspect.message_text import json_line

    width = max(map(len, rates))
    for name, rate in rates.items():
        text = f"{name:<{width}}  {rate_text(rate)}"
        print(json_line(rate_data(name, rate)) if is_json else text, flush=True)


def _require_messages(rates: "Mapping[str, TopicRate]", passed_s: float, limit_s: float) -> None:
    silent = [name for name, rate in rates.items() if not rate.count]
    if silent and passed_s >= limit_s:
        raise CommandFailedError(f"no message received on {', '.join(silent)} within {limit_s:g} s")


def _print_delay(
    topic: str,
    found: "Delay | None",
    unstamped: int,
    passed_s: float,
    limit_s: float,
    *,
    is_json: bool,
) -> None:
    from obk_cli.introspect.message_text import json_line

    if found is not None:
        print(json_line(delay_data(topic, found)) if is_json else delay_text(found), flush=True)
    elif unstamped:
        raise CommandFailedError(
            f"the stamps of the messages on {topic} are zero: the publisher never sets them"
        )
    elif passed_s >= limit_s:
        raise CommandFailedError(f"no message received on {topic} within {limit_s:g} s")
    else:
        print(f"no message received on {topic} yet", file=sys.stderr)


SILENT_S: Final = 1.0
"""Minimum time without messages before a topic counts as silent; twice its longest interval, if
that is longer [s]."""


def rate_text(rate: "TopicRate") -> str:
    """The measured rate of a topic as text."""
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
        parts.append(f"no message for {age_s:.1f} s")
    return "  ".join(parts)


def rate_data(topic: str, rate: "TopicRate") -> dict[str, Any]:
    """The measured rate of a topic as JSON data."""
    return {"topic": topic, **asdict(rate)}


def delay_text(delay: "Delay") -> str:
    """The latency of a topic as text."""
    clock = f"the stamps come from another clock, {delay.pace:.3g} times as fast"
    zero = f"  (relative to the fastest message: {clock})" if delay.is_relative else ""
    if delay.is_simulated:
        zero = f"  (in simulated time, {delay.pace:.3g} times as fast)"
    return (
        f"mean {_ms(delay.mean_s)}  min {_ms(delay.min_s)}  max {_ms(delay.max_s)}  "
        f"std dev {_ms(delay.std_dev_s)}  {delay.seen} messages{zero}"
    )


def delay_data(topic: str, delay: "Delay") -> dict[str, Any]:
    """The latency of a topic as JSON data."""
    return {"topic": topic, **asdict(delay)}


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.3f} ms"


def _amount(count: float) -> str:
    for unit, size in (("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count:.0f} B"
