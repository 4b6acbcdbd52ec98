"""A plan as JSON, for other programs."""

import json
from dataclasses import asdict

from obk_cli.plan import Plan

__all__ = ["emit_plan"]


def emit_plan(plan: Plan) -> str:
    """The text of a plan: `name`, and `processes` in the order of the config."""
    return json.dumps(asdict(plan), indent=2, ensure_ascii=False) + "\n"
