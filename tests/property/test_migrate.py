"""Migrating is lossless: after a round trip, a config compiles to the same plan."""

import re
from dataclasses import asdict
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from obk_cli.compiler import Options, compile_source
from obk_cli.configedit.migrate import migrate_source
from obk_cli.diagnostics.source import SourceFile
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import PackageIndex

ROOT = Path(__file__).resolve().parents[2]
CORPUS = ROOT.parent / "shared" / "corpus"
FILES = sorted([*CORPUS.rglob("*.yaml"), *(ROOT / "examples").glob("*/*.yaml")])
CONFIGS = [path for path in FILES if path.name != "depth_config.yaml"]


def plan_of(path: Path, text: str) -> dict[str, object]:
    """The plan without locations; ignores errors of topics and surroundings."""
    environment = MachineEnvironment(path.parent, path.parent, {})
    environment.packages = PackageIndex(workspaces=(CORPUS,), prefixes=())
    options = Options(
        variables={},
        working_folder=path.parent,
        environment=environment,
        ignore=("OBK1", "OBK2", "OBK3", "OBK4", "OBK5"),
    )
    outcome = compile_source(SourceFile.of(str(path), text), options)
    assert not outcome.diagnostics
    assert outcome.plan is not None
    plan = asdict(outcome.plan)
    for node in plan["nodes"]:
        for made in (node, *node["rates"]):
            del made["origin"]
    return plan


def migrated(text: str, to: str) -> str:
    result = migrate_source(SourceFile.of("c.yaml", text), to)  # type: ignore[arg-type]
    assert not result.faults
    return result.text


def comments(text: str) -> list[str]:
    """The comments; a `#` within double quotes starts none."""
    found = re.findall(r'"(?:\\.|[^"\\])*"|(#[^\r\n]*)', text, re.DOTALL)
    return [comment for comment in found if comment]


@pytest.mark.mujoco
@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.name)
def test_a_config_compiles_to_the_same_plan_in_either_format(path: Path) -> None:
    text = path.read_bytes().decode()
    there = migrated(text, "key")
    back = migrated(there, "seed")
    original = plan_of(path, text)
    for other in (there, back, migrated(back, "key")):
        assert plan_of(path, other) == original
        assert comments(other) == comments(text)


@pytest.mark.parametrize("name", ["seed/dummy.yaml", "seed/dummy_py_sections.yaml"])
def test_the_seeds_round_trip_byte_for_byte(name: str) -> None:
    text = (CORPUS / name).read_text()
    there = migrated(text, "key")
    assert "\nonboard:" not in there
    assert migrated(there, "seed") == text


NAMES = st.sampled_from("pub_ctrl sub_est a my_timer true 1 on".split())
COMPONENTS = st.one_of(
    NAMES.map(lambda name: {"ros_parameter": f"{name}_setting"}),
    NAMES.map(lambda name: {"key": name}),
    NAMES.map(lambda name: {"ros_parameter": f"{name}_setting", "key": name}),
    NAMES.map(lambda name: {"key": "asdf", "ros_parameter": f"{name}_setting"}),
    NAMES.map(lambda name: {"ros_parameter": name}),
)
NODES = st.fixed_dictionaries(
    {"pkg": st.just("demo")},
    optional={
        "publishers": st.lists(COMPONENTS, max_size=3),
        "timers": st.lists(COMPONENTS, max_size=2) | COMPONENTS,
        "params": st.dictionaries(NAMES, st.text("ab \n#:'\"{}-\t", max_size=12), max_size=3),
    },
)
SECTIONS = st.dictionaries(
    st.sampled_from(["control", "estimation", "robot", "sensing"]),
    st.lists(NODES, min_size=1, max_size=3) | NODES,
    min_size=1,
)
HEADS = st.fixed_dictionaries({}, optional={"config": NAMES, "obk": st.just({"ignore": ["OBK4"]})})


@st.composite
def texts(draw: st.DrawFn) -> str:
    """A config in either format and in any layout, with comments wherever they are allowed."""
    head, sections = draw(HEADS), draw(SECTIONS)
    config = {**head, "onboard": sections} if draw(st.booleans()) else {**head, **sections}
    text: str = yaml.safe_dump(
        config,
        sort_keys=False,
        default_flow_style=draw(st.sampled_from([True, False, None])),
        indent=draw(st.sampled_from([2, 3, 4])),
        width=draw(st.sampled_from([20, 80, 1000])),
    )
    if all("\n" not in value and "'" not in value for value in _texts(config)):
        lines = text.splitlines(keepends=True)
        for place in draw(st.lists(st.integers(0, len(lines)), max_size=4)):
            lines.insert(place, draw(st.sampled_from(["# c\n", "    # d\n", "\n", "# e\t\n"])))
        text = "".join(lines)
    return text.replace("\n", draw(st.sampled_from(["\n", "\r\n"])))


def _texts(value: object) -> list[str]:
    if isinstance(value, dict):
        return [text for item in value.values() for text in _texts(item)]
    if isinstance(value, list):
        return [text for item in value for text in _texts(item)]
    return [str(value)]


def canonical(text: str) -> object:
    """The content of a config in either format, read by PyYAML."""
    value = yaml.load(text, Loader=yaml.BaseLoader)
    head = {key: item for key, item in value.items() if key in ("config", "obk")}
    sections = value.get("onboard") or {k: v for k, v in value.items() if k not in head}
    return head, {key: _nodes(section) for key, section in sections.items()}


def _nodes(section: object) -> list[object]:
    nodes = section if isinstance(section, list) else [section]
    return [{key: _components(key, value) for key, value in node.items()} for node in nodes]


def _components(key: str, value: object) -> object:
    if key not in ("publishers", "timers"):
        return value
    found = value if isinstance(value, list) else [value]
    return [
        {
            (c.get("key") or c["ros_parameter"]).removesuffix("_setting"),
            (c.get("ros_parameter") or c["key"]).removesuffix("_setting"),
        }
        for c in found
    ]


@given(texts())
def test_any_layout_has_the_same_meaning_in_both_formats(text: str) -> None:
    there = migrated(text, "key")
    back = migrated(there, "seed")
    for other in (there, back):
        assert canonical(other) == canonical(text)
        assert "'" in text or comments(other) == comments(text)
        assert other.count("\r") == (other.count("\n") if "\r" in text else 0)
    # A level in braces is kept.
    assert "onboard" not in there or "onboard: {" in text
    assert migrated(there, "key") == there
    assert migrated(back, "seed") == back


@given(st.text("ab:- \n[]{},&*'\"#?<key control robot publishers ros_parameter onboard _setting"))
def test_any_text_is_migrated_or_rejected(text: str) -> None:
    migrate_source(SourceFile.of("c.yaml", text), "key")
    migrate_source(SourceFile.of("c.yaml", text), "seed")
