"""The JSON schema accepts a config exactly if the checker finds no fault of its shape."""

import json
from collections.abc import Iterable, Iterator
from copy import deepcopy
from functools import cache
from math import inf
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from hypothesis import assume, given
from hypothesis import strategies as st

from obelisk_spec.yaml_core import load_yaml_core
from obk_cli.compiler import Options, compile_source
from obk_cli.diagnostics.source import SourceFile
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import PackageIndex

ROOT = Path(__file__).parents[2]
CORPUS = ROOT.parent / "shared/corpus"
FILES = (
    ROOT / "examples/dummy/dummy.yaml",
    ROOT / "examples/dummy/dummy_new.yaml",
    *sorted((CORPUS / "seed").glob("*.yaml")),
    *sorted((CORPUS / "field/config").glob("*.yaml")),
)
CASES = sorted((ROOT / "tests/cases/accept").glob("*/*.yaml"))


def read(files: Iterable[Path]) -> list[dict[str, Any]]:
    """The files whose content is a mapping."""
    texts = (load_yaml_core(path.read_text(encoding="utf-8")) for path in files)
    return [config for config in texts if isinstance(config, dict)]


# Neither ray casters nor configs that depend on other files.
CONFIGS = [config for config in read(FILES) if "config" in config and "include" not in config]


@cache
def configs_and_cases() -> list[dict[str, Any]]:
    """The configs to edit, read when the first test needs them."""
    return [*CONFIGS, *read(CASES)]


# Duplicate keys, two mixed formats, types of messages: a schema cannot compare several locations.
SHAPE_CODES = frozenset(f"OBK{n}" for n in (*range(101, 107), 109, 110, 111, 113, 114))
# The number of rays of a pattern is a product, which a schema cannot limit.
PRODUCT = "rays, expected at most"
KEYS = st.sampled_from(
    "name namespace qos env respawn on_crash log_level remappings device params callback_groups "
    "key msg_type topic foo sim is_simulated deadzone device_id time_step n_u viz_geoms obk dt "
    "publishers timer_period_sec max_age_sec stale_action history_depth callback_key "
    "impl sensor_type sensor_names".split()
)
WORDS = st.sampled_from(
    ["x", "", "a b", "None", "/a/b", "1", "a/b/c", "~/x", "/", "a/", "é", "on", "pkg/msg/Foo"]
)
SMALL = [1, 0, -1, 1.5, 0.0, -0.5, 2.0]
LARGE = [2**31 - 1, 2**31, 2**63 - 1, 2**63, -(2**63) - 1, 10**30, 10**400, 1e30, inf, -inf]
NUMBERS = st.sampled_from([*SMALL, *LARGE])
LEAVES = st.none() | st.booleans() | NUMBERS | WORDS
VALUES = (
    LEAVES
    | st.lists(LEAVES | st.lists(LEAVES, max_size=1), max_size=3)
    | st.dictionaries(KEYS, LEAVES, max_size=2)
)


def _is_whole(checker: jsonschema.TypeChecker, value: object) -> bool:
    """YAML and the checker distinguish `0.0` from `0`; JSON does not."""
    return isinstance(value, int) and not isinstance(value, bool)


SCHEMA = json.loads((ROOT / "schema/obelisk.schema.json").read_text(encoding="utf-8"))
DRAFT = jsonschema.Draft202012Validator
VALIDATOR = jsonschema.validators.extend(  # type: ignore[no-untyped-call]
    DRAFT, type_checker=DRAFT.TYPE_CHECKER.redefine("integer", _is_whole)
)(SCHEMA)


def shape_faults(config: dict[str, Any], environment: dict[str, str]) -> list[str]:
    """The findings of the checker about the shape."""
    text = yaml.safe_dump(config, sort_keys=False, allow_unicode=True)
    assert load_yaml_core(text) == config
    machine = MachineEnvironment(ROOT, ROOT, environment)
    machine.packages = PackageIndex(workspaces=(), prefixes=())
    options = Options(variables=environment, working_folder=ROOT, environment=machine)
    diagnostics = compile_source(SourceFile.of("<text>", text), options).diagnostics
    return [f"{fault.code} {fault.message}" for fault in diagnostics if fault.code in SHAPE_CODES]


def holders(value: Any) -> Iterator[Any]:
    """Every mapping and list with content."""
    if isinstance(value, dict | list) and value:
        yield value
        for inner in value.values() if isinstance(value, dict) else value:
            yield from holders(inner)


def places_of_numbers(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every number in the config: its mapping or list, and its key."""
    for holder in holders(value):
        for key, inner in holder.items() if isinstance(holder, dict) else enumerate(holder):
            if isinstance(inner, int | float) and not isinstance(inner, bool):
                yield holder, key


def places_of_scalars(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every scalar in the config, including null: its mapping or list, and its key."""
    for holder in holders(value):
        for key, inner in holder.items() if isinstance(holder, dict) else enumerate(holder):
            if not isinstance(inner, dict | list):
                yield holder, key


def as_text(scalar: object) -> str:
    """A scalar as a person would write it without quotes."""
    if scalar is None or isinstance(scalar, str):
        return scalar or ""
    return str(scalar).lower()


@st.composite
def with_variables(draw: st.DrawFn) -> tuple[dict[str, Any], dict[str, str]]:
    """A config with variables instead of one or more scalars, and an environment with
    these scalars."""
    config: dict[str, Any] = deepcopy(draw(st.sampled_from(configs_and_cases())))
    places = list(places_of_scalars(config))
    chosen = draw(st.lists(st.sampled_from(range(len(places))), min_size=1, unique=True))
    environment: dict[str, str] = {}
    for holder, place in (places[index] for index in chosen):
        name = f"OF_THE_USER_{len(environment)}"
        environment[name] = as_text(holder[place])
        holder[place] = f"${{{name}}}"
    return config, environment


@st.composite
def edited(
    draw: st.DrawFn, values: st.SearchStrategy[Any], numbers: st.SearchStrategy[Any]
) -> dict[str, Any]:
    """A config after one edit; every second edit changes a number, to test the bounds."""
    config: dict[str, Any] = deepcopy(draw(st.sampled_from(configs_and_cases())))
    if draw(st.booleans()):
        holder, place = draw(st.sampled_from(list(places_of_numbers(config))))
        holder[place] = draw(numbers)
        return config
    holder = draw(st.sampled_from(list(holders(config))))
    place = draw(st.sampled_from(list(holder if isinstance(holder, dict) else range(len(holder)))))
    match draw(st.sampled_from(["replace", "replace", "drop", "misspell", "add"])):
        case "drop":
            del holder[place]
        case "misspell" if isinstance(holder, dict):
            holder[f"{place}_"] = holder.pop(place)
        case "add" if isinstance(holder, dict):
            holder[draw(KEYS)] = draw(values)
        case _:
            holder[place] = draw(values)
    return config


@pytest.mark.parametrize("config", CONFIGS)
def test_the_schema_accepts_a_config_that_the_checker_accepts(config: dict[str, Any]) -> None:
    faults = shape_faults(config, {})
    refusals = [error.message for error in VALIDATOR.iter_errors(config)]
    assert bool(faults) == bool(refusals), (faults, refusals)


@given(edited(VALUES, NUMBERS))
def test_the_schema_accepts_an_edited_config_exactly_if_the_checker_does(
    config: dict[str, Any],
) -> None:
    faults = shape_faults(config, {})
    assume(not any(PRODUCT in fault for fault in faults))
    refusals = [error.message for error in VALIDATOR.iter_errors(config)]
    assert bool(faults) == bool(refusals), (faults, refusals)


@given(with_variables())
def test_the_schema_rejects_no_variable_that_the_checker_accepts(
    drawn: tuple[dict[str, Any], dict[str, str]],
) -> None:
    config, environment = drawn
    refusals = [error.message for error in VALIDATOR.iter_errors(config)]
    assert not refusals or shape_faults(config, environment), refusals
