"""Measure rates of nodes that do not report them, on the topics that they publish.

C++ nodes publish no `/diagnostics`. A controller publishes once per period of its timer, so the
topic's rate is that of the timer. Nothing is subscribed to until a node turns out not to report.
For nodes on simulated time, rates are measured in it (by `/clock`): a slow simulation does not
break them.
"""

import threading
import time
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Final

from obelisk_spec.runtime_protocol import TOLERANCE, USE_SIM_TIME, Rate
from obk_cli.clock import monotonic_s
from obk_cli.launch.events import OutputEvent, RatesReported, RatesUnreported
from obk_cli.plan.plan import PlannedNode, PlannedRate
from obk_cli.ros.meters import (
    WATCH_TURN_S,
    WATCH_WINDOW_S,
    RosMeter,
    TopicRate,
    watch_window_s,
)
from obk_cli.ros.participant import RosParticipant
from obk_cli.ros.simulated_clock import SimulatedClock, follow_clock
from obk_cli.ros.types import raw_type

__all__ = ["ExternalRates", "external_rate"]

REPORT_S: Final = 1.0
"""Time between two reports, as for nodes that report their own [s]."""
NO_MESSAGES: Final = TopicRate(count=0, lost=None, seen=0, window_s=0.0)
_US: Final = 1e6
_S: Final = 1e-9


class ExternalRates(AbstractContextManager["ExternalRates"]):
    """Measures, in a thread, the rates of nodes that do not report."""

    def __init__(
        self,
        participant: RosParticipant,
        nodes: Iterable[PlannedNode],
        report: Callable[[RatesReported], None],
    ) -> None:
        """Prepare; rates are measured once `on_event` reports a node.

        Args:
            participant: subscribes to the topics.
            nodes: the nodes that run here.
            report: receives the rates of a node once per second, from the thread.
        """
        self._participant = participant
        self._nodes = {node.full_name: node for node in nodes}
        self._report = report
        self._added: SimpleQueue[str] = SimpleQueue()
        self._end = threading.Event()
        self._thread: threading.Thread | None = None
        self._clock = SimulatedClock()

    def on_event(self, event: OutputEvent) -> None:
        """Measure the rates of a node that does not report them."""
        if isinstance(event, RatesUnreported) and event.measured:
            self._added.put(event.node)
            if self._thread is None:
                self._thread = threading.Thread(target=self._measure, daemon=True)
                self._thread.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop measuring."""
        self._end.set()
        if self._thread is not None:
            self._thread.join()

    def _measure(self) -> None:
        meter = RosMeter(self._participant, WATCH_WINDOW_S, WATCH_TURN_S)
        since: dict[str, float | None] = {}
        reported_s, epoch = monotonic_s(), self._clock.epoch
        while not self._end.is_set():
            while (node := self._next_added()) is not None:
                if is_on_simulated_time(self._nodes[node]):
                    follow_clock(meter, self._clock)
                since[node] = self._now_s(self._nodes[node])
                self._subscribe(meter, self._nodes[node])
            meter.turn()
            if self._clock.epoch != epoch:
                epoch = self._clock.epoch
                since.update(self._start_again(meter, since))
            if monotonic_s() - reported_s < REPORT_S:
                continue
            reported_s = monotonic_s()
            for node, since_s in since.items():
                now_s = self._now_s(self._nodes[node])
                if since_s is None:
                    since[node] = now_s
                elif now_s is not None:
                    self._report_node(meter, self._nodes[node], now_s - since_s)
        meter.close()

    def _start_again(self, meter: RosMeter, nodes: Iterable[str]) -> dict[str, None]:
        """Restart the measurement of nodes on simulated time, after it was reset; return them."""
        restarted = [node for node in nodes if is_on_simulated_time(self._nodes[node])]
        for node in restarted:
            subscribed = meter.rates().keys()
            for topic in {expected.topic for expected in self._nodes[node].rates}:
                if topic is not None and topic in subscribed:
                    meter.drop(topic)
            self._subscribe(meter, self._nodes[node])
        return dict.fromkeys(restarted)

    def _now_s(self, node: PlannedNode) -> float | None:
        """The time base of a node's rates [s]; None: not known yet."""
        if not is_on_simulated_time(node):
            return monotonic_s()
        now_ns = self._clock.at(time.time_ns())
        return None if now_ns is None else now_ns * _S

    def _report_node(self, meter: RosMeter, node: PlannedNode, measured_s: float) -> None:
        """Report rates with a full window; without messages, a rate is 0 Hz."""
        self._subscribe(meter, node)
        seen = meter.rates()
        rates = tuple(
            external_rate(expected, seen.get(expected.topic, NO_MESSAGES))
            for expected in node.rates
            if expected.topic is not None and measured_s > watch_window_s(expected.period_s)
        )
        if rates:
            self._report(RatesReported(node=node.full_name, rates=rates, is_external=True))

    def _next_added(self) -> str | None:
        try:
            return self._added.get_nowait()
        except Empty:
            return None

    def _subscribe(self, meter: RosMeter, node: PlannedNode) -> None:
        """Subscribe to the node's topics that exist by now."""
        subscribed = meter.rates().keys()
        for expected in node.rates:
            if expected.topic is None or expected.topic in subscribed:
                continue
            seen = self._participant.topic(expected.topic)
            for msg_type in seen.published_types[:1]:
                python_type = raw_type(msg_type, (end.type_hash for end in seen.publishers))
                window = watch_window_s(expected.period_s)
                meter.add(
                    expected.topic,
                    msg_type,
                    python_type,
                    window_s=window,
                    is_light=True,
                    clock=self._clock.at if is_on_simulated_time(node) else None,
                )


def is_on_simulated_time(node: PlannedNode) -> bool:
    """Return whether the timers of a node follow `/clock`."""
    return bool(node.parameters.get(USE_SIM_TIME))


def external_rate(expected: PlannedRate, seen: TopicRate) -> Rate:
    """Return the rate measured on a topic; needs a full window, with or without messages."""
    measured_hz = seen.rate_hz or 0.0
    if seen.age_s:  # as if the next message arrived now
        measured_hz = min(measured_hz, max(1 / seen.age_s, 0.0))
    is_low = measured_hz < (1 - TOLERANCE) / expected.period_s
    return Rate(
        name=expected.name,
        expected_hz=1 / expected.period_s,
        measured_hz=measured_hz,
        ticks=seen.count,
        overruns=0,
        late_p50_us=0.0,
        late_p99_us=(seen.jitter_s or 0.0) * _US,
        late_max_us=max(0.0, (seen.max_s or 0.0) - expected.period_s) * _US,
        standing="broken" if is_low else "kept",
    )
