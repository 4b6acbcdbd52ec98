"""The JSON schema and the checker accept the same shapes."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from obelisk_spec import scans, sensors
from obelisk_spec.sensors import sensor_group
from obelisk_spec.yaml_core import load_yaml_core
from obk_cli.config import fields as keys

TABLES = {
    "node": keys.NODE_KEYS,
    "robot": keys.ROBOT_KEYS,
    "viz_node": keys.VIZ_NODE_KEYS,
    "component": keys.COMPONENT_KEYS,
    "timer": keys.TIMER_KEYS,
    "qos": keys.QOS_KEYS,
    "external_topic": keys.EXTERNAL_TOPIC_KEYS,
    "sim": keys.SIM_KEYS,
    "sensor_group": (*keys.SENSOR_GROUP_KEYS, *keys.OLDER_KEYS),
    "field_noise": sensors.FIELD_NOISE_KEYS,
    "viz": keys.VIZ_KEYS,
    "joystick": keys.JOYSTICK_KEYS,
    "device": keys.SECTION_KEYS,
    "ray_caster": tuple(scans.SCAN_KEYS),
    "ray_offset": tuple(scans.OFFSET_KEYS),
    **{name: ("type", "offset", *keys) for name, keys in scans.PATTERN_KEYS.items()},
}
SHAPE_CODES = ("OBK101", "OBK102", "OBK103", "OBK104", "OBK105", "OBK106", "OBK109", "OBK110")
GRID = {"type": "height_scan", "resolution": 0.1, "size": [1, 0]}
PINHOLE = {"type": "depth_camera", "width": 8, "height": 8}
MATRIX = [2, 0, 4, 0, 2, 4, 0, 0, 1]
VALID_PATTERNS: tuple[dict[str, Any], ...] = (
    GRID,
    GRID | {"offset": {"rot": [0, 0, 0, -1]}},
    PINHOLE | {"intrinsic_matrix": MATRIX},
    PINHOLE | {"intrinsic_matrix": [2.0, -1, 4, 0.0, 0.5, 4, -0.0, 0, 1.0]},
)
BROKEN_PATTERNS: tuple[dict[str, Any], ...] = (
    GRID | {"size": [1, -0.1]},
    GRID | {"offset": {"rot": [0, 0.0, -0.0, 0]}},
    PINHOLE | {"intrinsic_matrix": MATRIX[:-1]},
    *(
        PINHOLE | {"intrinsic_matrix": [*MATRIX[:place], wrong, *MATRIX[place + 1 :]]}
        for place, wrong in ((0, 0), (3, 1), (4, -2), (6, 0.5), (7, -1), (8, 0), (1, "x"))
    ),
)
CASES = Path(__file__).parents[3] / "cases"


def is_about_its_own_shape(path: Path) -> bool:
    """Whether a reject case is about shape, and not about a file that it names."""
    report = path.with_suffix(".txt").read_text(encoding="utf-8")
    return path.parent.name in SHAPE_CODES and report.startswith(f"{path.name}:")


@pytest.fixture(scope="module")
def schema(repository: Path) -> dict[str, Any]:
    text = (repository / "schema" / "obelisk.schema.json").read_text(encoding="utf-8")
    loaded: dict[str, Any] = json.loads(text)
    return loaded


@pytest.fixture(scope="module")
def validator(schema: dict[str, Any]) -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(schema)


def test_is_a_valid_schema(schema: dict[str, Any]) -> None:
    jsonschema.Draft202012Validator.check_schema(schema)


def test_has_the_keys_of_the_language(schema: dict[str, Any]) -> None:
    assert set(schema["properties"]) == set(keys.RESERVED_KEYS)
    for name, table in TABLES.items():
        assert set(schema["$defs"][name]["properties"]) == set(table), name


def mappings(value: Any) -> Iterator[dict[str, Any]]:
    """Every mapping of the schema, at any depth."""
    if isinstance(value, dict):
        yield value
    for inner in value.values() if isinstance(value, dict) else value:
        if isinstance(inner, dict | list):
            yield from mappings(inner)


def test_every_key_has_a_title_and_a_description(schema: dict[str, Any]) -> None:
    places = [schema, *schema["$defs"].values(), schema["$defs"]["sim"]["properties"]["viz_geoms"]]
    for place in places:
        for key, value in place.get("properties", {}).items():
            assert value.get("title"), key
            assert value.get("description"), key


def test_every_definition_has_a_title_and_a_description(schema: dict[str, Any]) -> None:
    of_any_name = [
        value
        for mapping in mappings(schema)
        if isinstance(value := mapping.get("additionalProperties"), dict)
    ]
    assert len(of_any_name) > 10
    for value in of_any_name:
        assert value.get("title"), value
        assert value.get("description"), value


@pytest.mark.parametrize("path", sorted(CASES.glob("accept/*/*.yaml")), ids=lambda p: p.stem)
def test_accepts_what_the_checker_accepts(
    path: Path, validator: jsonschema.Draft202012Validator
) -> None:
    validator.validate(load_yaml_core(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    "path",
    [p for p in sorted(CASES.glob("reject/*/*.yaml")) if is_about_its_own_shape(p)],
    ids=lambda p: f"{p.parent.name}-{p.stem}",
)
def test_rejects_the_shapes_that_the_checker_rejects(
    path: Path, validator: jsonschema.Draft202012Validator
) -> None:
    assert not validator.is_valid(load_yaml_core(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("pattern", [*VALID_PATTERNS, *BROKEN_PATTERNS], ids=str)
def test_bounds_the_numbers_of_a_ray_pattern_as_the_checker_does(
    pattern: dict[str, Any], schema: dict[str, Any]
) -> None:
    scan = {"site_name": "head", "pattern": pattern}
    rule = sensor_group("PointCloud2" if pattern["type"] == "height_scan" else "DepthImage")
    assert rule is not None
    faults = list(scans.check_scan(scan, "a group", rule, ()))
    refusals = list(
        jsonschema.Draft202012Validator(
            {"$ref": "#/$defs/ray_caster", "$defs": schema["$defs"]}
        ).iter_errors(scan)
    )
    assert bool(faults) == bool(refusals) == (pattern in BROKEN_PATTERNS), (faults, refusals)
