"""Nodes of plans, for tests that compile no config."""

from obk_cli.plan.plan import Origin, PlannedNode

__all__ = ["node"]


def node(name: str, section: str = "control", **others: object) -> PlannedNode:
    """A node at the top of the graph, except for the given fields."""
    fields: dict[str, object] = {
        "node": name,
        "namespace": "/",
        "section": section,
        "device": "onboard",
        "package": "p",
        "executable": "e",
        "origin": Origin(path="c.yaml", line=1, column=1),
    }
    return PlannedNode(**{**fields, **others})  # type: ignore[arg-type]
