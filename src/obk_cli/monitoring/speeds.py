"""How fast the time of simulated robots passes, by their own word.

A robot reads its `realtime_factor` at configure and refuses another one until it is cleaned up. So
it is asked once it is configured, and again after somebody has set the parameter.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Final

from obk_cli.errors import CommandFailedError
from obk_cli.introspect.parameters import NodeParameter
from obk_cli.runs.lifecycle import ACTIVE, INACTIVE
from obk_cli.runs.protocol import NodeStatus

__all__ = ["REALTIME_FACTOR", "AskFactor", "Speeds"]

REALTIME_FACTOR: Final = "realtime_factor"
"""The parameter: simulation time over wall time; 0: as fast as possible."""

AskFactor = Callable[[str], NodeParameter]
"""Asks a node, by its full name, for the parameter; raises a CommandFailedError without answer."""


class Speeds:
    """The real-time factors of the simulated robots of one stack."""

    def __init__(self, simulated: Collection[str], ask: AskFactor) -> None:
        """Begin with none.

        Args:
            simulated: full names of the robots.
            ask: asks one of them.
        """
        self._simulated = simulated
        self._ask = ask
        self._known: dict[str, float] = {}

    @property
    def factors(self) -> Mapping[str, float]:
        """Full name -> factor of the robots that are configured and have told."""
        return dict(self._known)

    def hear(self, _received_ns: int, event: bytes) -> None:
        """Take a serialized `ParameterEvent` of any node."""
        if REALTIME_FACTOR.encode() in event:
            self._known.clear()

    def look(self, nodes: Iterable[NodeStatus]) -> None:
        """Ask the robots that are configured by now and have not told yet."""
        for node in nodes:
            is_configured = node.state in (INACTIVE, ACTIVE)
            if node.node in self._simulated and is_configured and node.node not in self._known:
                self._learn(node.node)

    def _learn(self, node: str) -> None:
        try:
            value = self._ask(node).value
        except CommandFailedError:
            return  # it is asked again with the next look
        if isinstance(value, int | float):
            self._known[node] = float(value)
