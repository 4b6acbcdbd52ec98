"""What nodes tell on `/diagnostics` of their rates, as values."""

from collections.abc import Callable, Iterable
from typing import Any, Final

from obelisk_spec.rates import DIAGNOSTICS_TOPIC, parse_rate
from obk_cli.launch.events import RatesReported

__all__ = ["listen_to_rates", "rates_told"]

_DEPTH: Final = 100
"""Each node of a large stack tells once a second, and all of them may do so at once."""


def listen_to_rates(node: Any, nodes: Iterable[str], hear: Callable[[RatesReported], None]) -> None:
    """Hear of the rates of these nodes, from the thread that spins.

    Args:
        node: of rclpy, that listens.
        nodes: full names; what others tell is left aside.
        hear: takes what they tell.
    """
    from diagnostic_msgs.msg import DiagnosticArray

    names = frozenset(nodes)

    def on_message(message: Any) -> None:
        told = rates_told(message)
        if told is not None and told.node in names:
            hear(told)

    node.create_subscription(DiagnosticArray, DIAGNOSTICS_TOPIC, on_message, _DEPTH)


def rates_told(message: Any) -> RatesReported | None:
    """The rates in a `diagnostic_msgs/DiagnosticArray`; None where it has none."""
    found = tuple(
        rate
        for status in message.status
        if (rate := parse_rate(status.name, status.level[0], _values(status))) is not None
    )
    return RatesReported(node=str(message.status[0].hardware_id), rates=found) if found else None


def _values(status: Any) -> dict[str, str]:
    return {str(pair.key): str(pair.value) for pair in status.values}
