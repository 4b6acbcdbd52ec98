"""The rates and films that nodes report on `/diagnostics`, as events."""

from collections.abc import Callable, Iterable
from typing import Any, Final

from obelisk_spec.runtime_protocol import DIAGNOSTICS_TOPIC, parse_rate
from obelisk_spec.video import parse_video
from obk_cli.launch.events import RatesHeard, VideoReported

__all__ = ["film_reported", "listen_to_rates", "rates_told"]

_DEPTH: Final = 100
"""Each node of a large stack tells once a second, and all of them may do so at once."""


def listen_to_rates(
    node: Any, nodes: Iterable[str], publish: Callable[[RatesHeard | VideoReported], None]
) -> None:
    """Publish the rates and films that these nodes report, from the thread that spins.

    Args:
        node: of rclpy, makes the subscription.
        nodes: full names; reports of other nodes are ignored.
        publish: takes the events.
    """
    from diagnostic_msgs.msg import DiagnosticArray

    names = frozenset(nodes)

    def on_message(message: Any) -> None:
        for event in (rates_told(message), film_reported(message)):
            if event is not None and event.node in names:
                publish(event)

    node.create_subscription(DiagnosticArray, DIAGNOSTICS_TOPIC, on_message, _DEPTH)


def rates_told(message: Any) -> RatesHeard | None:
    """The rates in a `diagnostic_msgs/DiagnosticArray`; None where it has none."""
    found = tuple(
        rate
        for status in message.status
        if (rate := parse_rate(status.name, status.level[0], _values(status))) is not None
    )
    return RatesHeard(node=str(message.status[0].hardware_id), rates=found) if found else None


def film_reported(message: Any) -> VideoReported | None:
    """The film in a `diagnostic_msgs/DiagnosticArray`; None if it has none."""
    for status in message.status:
        film = parse_video(status.name, _values(status))
        if film is not None:
            return VideoReported(node=str(status.hardware_id), film=film)
    return None


def _values(status: Any) -> dict[str, str]:
    return {str(pair.key): str(pair.value) for pair in status.values}
