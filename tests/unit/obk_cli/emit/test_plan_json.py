"""The plan as JSON follows its schema, and the schema describes everything."""

import json
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import jsonschema
import pytest

from obk_cli.emit.json import emit_plan
from obk_cli.files import resource_folder
from obk_cli.plan.plan import Endpoint, Origin, Plan, PlannedNode, PlannedRate, PlannedSensorGroup

from .plans import loop, node

SCHEMA: dict[str, Any] = json.loads((resource_folder("schema") / "plan.schema.json").read_text())
DEFINITIONS = {
    "process": PlannedNode,
    "endpoint": Endpoint,
    "origin": Origin,
    "rate": PlannedRate,
    "sensor_group": PlannedSensorGroup,
}


def faults(plan: dict[str, Any]) -> list[str]:
    validator = jsonschema.Draft202012Validator(SCHEMA)
    return [error.message for error in validator.iter_errors(plan)]


def schemas(value: Any) -> Iterator[dict[str, Any]]:
    """All schemas in a schema."""
    if isinstance(value, dict):
        if value.keys() & {"type", "anyOf", "enum"} and isinstance(
            value.get("type", ""), str | list
        ):
            yield value
        for item in value.values():
            yield from schemas(item)
    elif isinstance(value, list):
        for item in value:
            yield from schemas(item)


def test_the_schema_is_valid_and_describes_everything() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert all({"title", "description"} <= schema.keys() for schema in schemas(SCHEMA))


@pytest.mark.parametrize("name", DEFINITIONS)
def test_the_schema_has_the_plans_fields(name: str) -> None:
    names = {field.name for field in fields(DEFINITIONS[name])}
    assert set(SCHEMA["$defs"][name]["properties"]) == names
    assert set(SCHEMA["$defs"][name]["required"]) == names


def test_an_emitted_plan_keeps_to_the_schema() -> None:
    strange = {
        "floats": (1.0, float("inf")),
        "nan": float("nan"),
        "half": "\ud800",
        "flags": (True,),
        "names": ("a",),
        "count": 3,
    }
    plan = Plan(name="x", nodes=(*loop().nodes, node("viz", parameters=strange)))
    text = emit_plan(plan).encode()
    assert faults(json.loads(text)) == []
    assert json.loads(text)["processes"][-1]["parameters"] == {
        "floats": [1.0, ".inf"],
        "nan": ".nan",
        "half": "\ud800",
        "flags": [True],
        "names": ["a"],
        "count": 3,
    }


@pytest.mark.parametrize(
    ("key", "value"), [("section", "brain"), ("namespace", "left"), ("parameters", {"x": None})]
)
def test_invalid_plans_are_rejected(key: str, value: object) -> None:
    plan = json.loads(emit_plan(loop()))
    plan["processes"][0][key] = value
    assert faults(plan)
