"""Adding a node to a config keeps the meaning and every byte of the existing text."""

from collections import Counter
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from obelisk_spec.names import resolve_msg_type
from obk_cli.compiler import Options, Outcome, compile_source
from obk_cli.config.model import Node
from obk_cli.config.topology import node_endpoints
from obk_cli.configedit.add_node import add_node
from obk_cli.configedit.new_node import NewNode, Rejected, read_new_node
from obk_cli.diagnostics.source import SourceFile
from obk_cli.scaffold.package_spec import MessageType, PackageSpec
from obk_cli.scaffold.variables import config_snippet
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import PackageIndex

ROOT = Path(__file__).resolve().parents[2]
CORPUS = ROOT.parent / "shared" / "corpus"
FRAGMENTS = ("depth_config.yaml", "dummy_composed_base.yaml", "dummy_composed_robot_sim.yaml")
FILES = sorted([*CORPUS.rglob("*.yaml"), *(ROOT / "examples").glob("*/*.yaml")])
CONFIGS = [path for path in FILES if path.name not in FRAGMENTS]
LACKS = (
    "publishes ObkJointEncoders",
    "no robot subscribes to PositionSetpoint",
    "nothing in `control` publishes PositionSetpoint",
)
"""Parts that a real config may lack and the new node needs."""
SECTIONS = {
    "controller": "control",
    "estimator": "estimation",
    "robot": "robot",
    "sensor": "sensing",
}


def message(name: str) -> MessageType:
    package, _, bare = (resolve_msg_type(name) or "").partition("/msg/")
    return MessageType(package=package, name=bare)


def new_node_of(kind: str, sensor: str = "ObkJointEncoders") -> NewNode:
    spec = PackageSpec(
        kind=kind,  # type: ignore[arg-type]
        package="new_node",
        node="new_node",
        ctrl=message("PositionSetpoint"),
        est=message("EstimatedState"),
        sensor=message(sensor),
    )
    return read_new_node(SECTIONS[kind], config_snippet(spec))


def options(folder: Path, *ignore: str) -> Options:
    environment = MachineEnvironment(folder, folder, {})
    environment.packages = PackageIndex(workspaces=(CORPUS,), prefixes=())
    return Options(variables={}, working_folder=folder, environment=environment, ignore=ignore)


def is_subsequence(part: str, whole: str) -> bool:
    letters = iter(whole)
    return all(letter in letters for letter in part)


def ends(node: Node) -> list[tuple[str, str]]:
    return [(end.direction, end.topic) for end in node_endpoints(node)]


def serious(outcome: Outcome) -> Counter[tuple[str, str]]:
    return Counter((f.code, f.severity) for f in outcome.diagnostics if f.severity != "info")


@pytest.mark.mujoco
@pytest.mark.parametrize("kind", SECTIONS)
@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.name)
def test_a_real_config_validates_as_before(path: Path, kind: str) -> None:
    text = path.read_bytes().decode()
    source, of_folder = SourceFile.of(str(path), text), options(path.parent, "OBK401")
    added = add_node(source, new_node_of(kind), of_folder)
    if isinstance(added, Rejected):
        assert added.snippet or any(lack in added.sentence for lack in LACKS)
        return
    before = compile_source(source, of_folder)
    after = compile_source(SourceFile.of(str(path), added.text), of_folder)
    was_whole = not any(code == "OBK203" for code, _ in serious(before))
    worse = serious(after) - serious(before)
    assert not [code for code, severity in worse if was_whole or severity == "error"]
    assert before.config is not None
    assert after.config is not None
    kept = [node for node in after.config.nodes if node.full_name != added.node_name]
    assert [ends(node) for node in kept] == [ends(node) for node in before.config.nodes]
    is_list_made = any("is now a list" in note for note in added.notes)
    assert is_subsequence(text.replace(" ", "") if is_list_made else text, added.text)
    (new,) = [node for node in after.config.nodes if node not in kept]
    assert {topic for _, topic in ends(new)} == {link.topic for link in added.links}


PARTS: dict[str, dict[str, object]] = {
    "control": {
        "publishers": [{"key": "pub_ctrl", "topic": "/a/ctrl", "msg_type": "PositionSetpoint"}],
        "subscribers": [{"key": "sub_est", "topic": "/a/est", "msg_type": "EstimatedState"}],
        "timers": [{"key": "timer_ctrl", "timer_period_sec": 0.5}],
    },
    "estimation": {
        "publishers": [{"key": "pub_est", "topic": "/a/est", "msg_type": "EstimatedState"}],
        "subscribers": [{"key": "sub_sensor", "topic": "/a/q", "msg_type": "ObkJointEncoders"}],
    },
    "robot": {
        "is_simulated": False,
        "publishers": [{"key": "pub_q", "topic": "/a/q", "msg_type": "ObkJointEncoders"}],
        "subscribers": [{"key": "sub_ctrl", "topic": "/a/ctrl", "msg_type": "PositionSetpoint"}],
    },
    "sensing": {"publishers": [{"key": "pub_s", "topic": "/a/s", "msg_type": "ObkImu"}]},
}
WORDS = st.text("ab \n#:'\"{}[],&*-\t", max_size=12)


@st.composite
def nodes(draw: st.DrawFn, section: str) -> dict[str, object]:
    node: dict[str, object] = {"pkg": "demo", "executable": section, **PARTS[section]}
    if draw(st.booleans()):
        node["params"] = draw(st.dictionaries(st.sampled_from("abc"), WORDS, min_size=1))
    return dict(draw(st.permutations(list(node.items()))))


@st.composite
def texts(draw: st.DrawFn) -> str:
    """A valid config in either format and in any layout, with comments and blank lines."""
    sections: dict[str, object] = {}
    for section in draw(st.permutations(list(PARTS))):
        node = draw(nodes(section))
        sections[section] = draw(st.sampled_from([node, [node]]))
    if draw(st.booleans()):
        sections["sensing"] = draw(st.sampled_from([None, []]))
    elif draw(st.booleans()):
        del sections["sensing"]
    top = {"onboard": sections} if draw(st.booleans()) else sections
    text: str = yaml.safe_dump(
        {"config": "a", **top} if draw(st.booleans()) else {**top, "config": "a"},
        sort_keys=False,
        default_flow_style=draw(st.sampled_from([True, False, None])),
        indent=draw(st.sampled_from([2, 3, 4])),
        width=draw(st.sampled_from([20, 80, 1000])),
    )
    lines = text.splitlines(keepends=True)
    if not any(mark in text for mark in ("'", '"', "|", "\\")):  # no text with several lines
        for place in draw(st.lists(st.integers(0, len(lines)), max_size=5)):
            lines.insert(place, draw(st.sampled_from(["# c\n", "      # d\n", "\n", "  # e\n"])))
    text = "".join(lines)
    if draw(st.booleans()):
        text = text.rstrip("\n")
    return text.replace("\n", draw(st.sampled_from(["\n", "\r\n"])))


def read(text: str) -> dict[str, list[object]]:
    """The sections as lists, read by PyYAML."""
    value = yaml.safe_load(text)
    sections = value.get("onboard") or value
    listed = {key: sections.get(key) or [] for key in PARTS}
    return {key: item if isinstance(item, list) else [item] for key, item in listed.items()}


@given(texts(), st.sampled_from(list(SECTIONS)))
def test_in_any_layout_the_node_is_all_that_is_new(text: str, kind: str) -> None:
    added = add_node(
        SourceFile.of("c.yaml", text), new_node_of(kind), options(Path("/"), "OBK4", "OBK5")
    )
    if isinstance(added, Rejected):
        # Only flow style is not: the whole text, or a section.
        assert "{" in text
        (pasted,) = yaml.safe_load(added.snippet)
        assert pasted["pkg"] == "new_node"
        return
    before, after = read(text), read(added.text)
    section = SECTIONS[kind]
    *kept, new = after.pop(section)
    assert kept == before.pop(section)
    assert after == before
    assert isinstance(new, dict)
    assert (new["pkg"], new["executable"]) == ("new_node", "new_node")
    assert comments(added.text) == comments(text)
    assert added.text.count("\r") == (added.text.count("\n") if "\r" in text else 0)
    assert added.text.endswith(("\n", "\r\n")) == text.endswith(("\n", "\r\n"))


def comments(text: str) -> list[str]:
    """The lines that are comments, if no text of the config can look like one."""
    has_text = any(mark in text for mark in ("'", '"', "|", "\\"))
    return [] if has_text else [line for line in text.split() if line.startswith("#")]


@given(
    st.text("ab:- \n[]{},&*'\"#?<key control robot publishers onboard _setting"),
    st.sampled_from(list(SECTIONS)),
)
def test_any_text_is_edited_or_rejected(text: str, kind: str) -> None:
    add_node(SourceFile.of("c.yaml", text), new_node_of(kind), options(Path("/")))
