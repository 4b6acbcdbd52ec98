"""A plan as JSON, for other programs; `schema/plan.schema.json` describes it."""

from dataclasses import asdict

from obk_cli.emit.json_text import json_text
from obk_cli.plan.plan import Plan

__all__ = ["emit_plan"]


def emit_plan(plan: Plan) -> str:
    """The text of a plan: `name`, and `processes` in the order of the config."""
    return json_text(asdict(plan))
