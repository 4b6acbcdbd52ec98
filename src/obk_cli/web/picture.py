"""The picture of a running stack, drawn from the plan that its run's folder keeps."""

from obk_cli.emit.graph import graph_of
from obk_cli.emit.svg import emit_svg
from obk_cli.plan.plan import Plan

__all__ = ["live_picture"]


def live_picture(plan: Plan) -> str:
    """An SVG whose boxes a page fills; empty where the plan has no nodes."""
    return emit_svg(graph_of(plan), is_live=True) if plan.processes else ""
