"""The picture of a running stack, drawn from the plan that its run's folder keeps."""

from collections.abc import Mapping
from typing import Any

from obk_cli.emit.graph import graph_of
from obk_cli.emit.svg import emit_svg
from obk_cli.plan import Endpoint, Origin, Plan, Process, SensorGroup

__all__ = ["live_picture"]


def live_picture(plan: Mapping[str, Any]) -> str:
    """An SVG whose boxes a page fills; empty where the plan tells no nodes.

    Args:
        plan: as `emit_plan` writes it.
    """
    processes = tuple(map(_process, plan.get("processes", ())))
    if not processes:
        return ""
    return emit_svg(graph_of(Plan(name=plan["name"], processes=processes)), is_live=True)


def _process(told: Mapping[str, Any]) -> Process:
    """What a picture shows of it."""
    return Process(
        node=told["node"],
        namespace=told["namespace"],
        section=told["section"],
        device=told["device"],
        package=told["package"],
        executable=told["executable"],
        origin=Origin(**told["origin"]),
        publishes=tuple(Endpoint(**end) for end in told["publishes"]),
        subscribes=tuple(Endpoint(**end) for end in told["subscribes"]),
        model=told["model"],
        sensor_groups=tuple(SensorGroup(**group) for group in told["sensor_groups"]),
    )
