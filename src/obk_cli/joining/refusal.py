"""Why a node cannot join a config, as a value; nothing has been changed then."""

from dataclasses import dataclass

from obk_cli.diagnostics.diagnostic import Diagnostic

__all__ = ["Refused"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Refused:
    """What is in the way, and what would be right."""

    sentence: str
    help: str
    component: str | None = None
    """The component of the new node that nothing fits, `sub_sensor`."""
    findings: tuple[Diagnostic, ...] = ()
    """The config's own faults, or those that it would have with the node."""
