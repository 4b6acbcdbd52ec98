"""Are the message packages of Obelisk compiled, loadable and as their sources are? Pure."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from obk_cli.doctor.finding import Finding, error, ok, warning

__all__ = ["InterfaceFacts", "judge_interfaces"]


@dataclass(frozen=True, slots=True, kw_only=True)
class InterfaceFacts:
    """The compiled messages of this environment."""

    version: str | None
    """Of the distribution obelisk-interfaces, None where they come from elsewhere."""
    faults: Mapping[str, str]
    """Package -> why its compiled part cannot be loaded."""
    loaded: tuple[str, ...]
    stale: tuple[str, ...]
    """Definitions that were changed, in this checkout, since they were compiled."""
    has_sources: bool
    """Whether obk runs from a checkout that has the definitions."""


def judge_interfaces(facts: InterfaceFacts) -> Iterator[Finding]:
    """Whether nodes can exchange Obelisk's messages."""
    cure = "make setup" if facts.has_sources else "pip install 'obelisk-cli[ros]'"
    for package, fault in facts.faults.items():
        yield error(f"the messages of {package} cannot be used: {fault}", cure)
    if facts.stale:
        yield warning(
            f"changed since they were compiled: {', '.join(facts.stale)}", cure, stale=facts.stale
        )
    if facts.loaded:
        named = f"obelisk-interfaces {facts.version}" if facts.version else "Obelisk's messages"
        yield ok(f"{named}: {', '.join(facts.loaded)}", packages=facts.loaded)
