"""What every check is given: the typed config, its topics, and what is known of the machine."""

from dataclasses import dataclass

from obk_cli.config import Stack
from obk_cli.surroundings import Surroundings
from obk_cli.wiring import Topology

__all__ = ["CheckContext"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckContext:
    """A config to check."""

    stack: Stack
    topology: Topology
    surroundings: Surroundings
