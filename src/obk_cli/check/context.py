"""The input of every check: the typed config, its topics, and facts about the machine."""

from dataclasses import dataclass

from obk_cli.config.environment import Environment
from obk_cli.config.model import Stack
from obk_cli.config.topology import Topology

__all__ = ["CheckContext"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckContext:
    """A config to check."""

    stack: Stack
    topology: Topology
    environment: Environment
