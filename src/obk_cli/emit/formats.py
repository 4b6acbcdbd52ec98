"""All output formats of a plan, by their `--to` name."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from obk_cli.emit.graph import graph_of
from obk_cli.emit.graphviz import emit_dot, emit_svg
from obk_cli.emit.json import emit_graph_json, emit_plan
from obk_cli.emit.launch_file import emit_launch_file
from obk_cli.emit.mermaid import emit_mermaid
from obk_cli.emit.params import emit_params
from obk_cli.plan.plan import Plan

__all__ = ["FORMS", "Form"]


@dataclass(frozen=True, slots=True)
class Form:
    """An output format."""

    emit: Callable[[Plan], str]
    ending: str
    """File extension, such as `.params.yaml`."""


FORMS: Final[Mapping[str, Form]] = MappingProxyType(
    {
        "plan": Form(emit_plan, ".plan.json"),
        "params": Form(lambda plan: emit_params(plan.nodes), ".params.yaml"),
        "launch": Form(emit_launch_file, ".launch.py"),
        "mermaid": Form(lambda plan: emit_mermaid(graph_of(plan)), ".mmd"),
        "dot": Form(lambda plan: emit_dot(graph_of(plan)), ".dot"),
        "svg": Form(lambda plan: emit_svg(graph_of(plan)), ".svg"),
        "json": Form(lambda plan: emit_graph_json(graph_of(plan)), ".graph.json"),
    }
)
"""Name -> form."""
