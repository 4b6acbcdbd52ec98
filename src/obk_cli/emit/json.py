"""A plan and its graph as JSON: readable, always valid, always UTF-8.

`schema/plan.schema.json` describes the plan.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict

from obk_cli.emit.graph import Graph
from obk_cli.plan.plan import Plan

__all__ = ["emit_graph_json", "emit_plan", "json_text"]


def emit_plan(plan: Plan) -> str:
    """The text of a plan: `name`, `processes` in the order of the config, `external_topics`."""
    values = asdict(plan).items()
    # The JSON key is older than the field's name, and must stay.
    return json_text({"processes" if key == "nodes" else key: value for key, value in values})


def emit_graph_json(graph: Graph) -> str:
    """The graph: `name`, `devices`, `nodes`, `topics`, and `edges` from node to topic to node."""
    topics = [asdict(topic) for topic in graph.topics]
    for topic in topics:  # `edges` holds the ends of topics
        del topic["publishers"], topic["subscribers"]
    return json_text(
        {
            "name": graph.name,
            "devices": graph.devices,
            "nodes": [asdict(node) for node in graph.nodes],
            "topics": topics,
            "edges": list(_edges(graph)),
        }
    )


def _edges(graph: Graph) -> Iterator[dict[str, str]]:
    for topic in graph.topics:
        for node in topic.publishers:
            yield {"kind": "publishes", "from": node, "to": topic.name}
        for node in topic.subscribers:
            yield {"kind": "subscribes", "from": topic.name, "to": node}


_SURROGATE = re.compile("[\ud800-\udfff]")


def json_text(value: object) -> str:
    """Format a JSON document; numbers that JSON lacks become strings as in YAML, such as `.inf`."""
    text = json.dumps(_finite(value), indent=2, ensure_ascii=False, allow_nan=False)
    # UTF-8 cannot encode an unpaired surrogate, but JSON can escape it.
    return _SURROGATE.sub(lambda found: f"\\u{ord(found[0]):04x}", text) + "\n"


def _finite(value: object) -> object:
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else (".inf" if value > 0 else "-.inf")
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_finite(item) for item in value]
    return value
