"""Listings of all pages: `obk validate` accepts their YAML, their Python is valid, and so on."""

import ast
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from obelisk_spec.components import STALE_ACTIONS
from obelisk_spec.sensors import SENSOR_GROUPS
from obk_cli.compiler import Options, Outcome, compile_source
from obk_cli.configedit.migrate import migrate_source
from obk_cli.diagnostics.source import SourceFile
from obk_cli.plan.plan import PlannedNode
from obk_cli.report import report_text
from obk_cli.workspace.environment import MachineEnvironment

from ..documents import (  # noqa: TID252 - shared by folders of tests
    PAGES,
    ROOT,
    Block,
    blocks,
)

DUMMY = ROOT / "examples/dummy"
LISTINGS = [block for page in PAGES for block in blocks(page)]
RUN = {"sh", "diff", "text", "", "mermaid"}
"""Kinds that tests/ros/test_documents.py performs or compares, and drawings."""
OTHER_PROGRAMS = {"jobs", "repos", "id", "uses", "run"}
"""Keys of the listings for CI and pre-commit."""
PART = {"docs/how-to/migrating.md", "docs/how-to/variants.md"}
"""Pages whose configs are incomplete; separate tests migrate and merge them."""
IN_THE_WORLD = """
    <body>
      <freejoint/>
      <geom name="trunk_box" type="box" size="0.1 0.1 0.1"/>
      <site name="trunk"/>
      <camera name="front"/>
    </body>
  </worldbody>"""
SENSORS = """
    <accelerometer name="trunk_acc" site="trunk"/>
    <gyro name="trunk_gyro" site="trunk"/>
    <framequat name="trunk_quat" objtype="site" objname="trunk"/>
  </sensor>"""

pytestmark = pytest.mark.mujoco


def listings(page: str, kind: str) -> list[str]:
    return [block.body for block in blocks(ROOT / page) if block.kind == kind]


def compile_text(text: str, folder: Path) -> Outcome:
    environment = MachineEnvironment(folder, folder, {})
    options = Options(variables={}, working_folder=folder, environment=environment)
    return compile_source(SourceFile.of(str(folder / "listing.yaml"), text), options)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The dummy's folder, with a model that has everything that the pages name."""
    shutil.copytree(DUMMY, tmp_path, dirs_exist_ok=True)
    model = (DUMMY / "dummy.xml").read_text()
    keyframes = '<keyframe><key name="ic"/><key name="home"/><key name="other"/></keyframe>'
    model = re.sub(r"<keyframe>.*</keyframe>", keyframes, model, flags=re.DOTALL)
    model = model.replace("</worldbody>", IN_THE_WORLD).replace("</sensor>", SENSORS)
    (tmp_path / "dummy.xml").write_text(model)
    return tmp_path


def whole(listing: Any) -> dict[str, Any]:
    """A config: the listing, or the dummy's config with the listing's additions."""
    if isinstance(listing, dict) and "robot" in listing and "estimation" in listing:
        return listing
    stack: dict[str, Any] = yaml.safe_load((DUMMY / "dummy_new.yaml").read_text())
    if isinstance(listing, dict) and "external_topics" in listing:
        return {**stack, **listing}
    robot = stack["robot"]
    if isinstance(listing, dict) and "robot" in listing:
        more = listing["robot"][0] if isinstance(listing["robot"], list) else listing["robot"]
        sim = {**robot["sim"], **more.get("sim", {})}
        params = {**robot["params"], **more.get("params", {})}
        return {**stack, "robot": {**robot, **more, "sim": sim, "params": params}}
    groups = listing["sensor_settings"] if isinstance(listing, dict) else listing
    robot["sim"]["sensor_settings"] += groups
    return stack


def keys_of(listing: Any) -> set[str]:
    items = listing if isinstance(listing, list) else [listing]
    return {key for item in items if isinstance(item, dict) for key in item}


def check_yaml(block: Block, folder: Path) -> None:
    listing = yaml.safe_load(block.body)
    if keys_of(listing) & OTHER_PROGRAMS or str(block.page.relative_to(ROOT)) in PART:
        return
    outcome = compile_text(yaml.safe_dump(whole(listing)), folder)
    assert outcome.plan is not None, report_text(outcome.diagnostics, colour=False)
    found = [finding for finding in outcome.diagnostics if finding.severity != "info"]
    assert report_text(tuple(found), colour=False) == ""


def check_python(block: Block, _: Path) -> None:
    if block.body.startswith(" "):  # a part of an example's function
        modules = (path.read_text() for path in (ROOT / "examples").rglob("*.py"))
        assert any(block.body in module for module in modules)
    else:
        ast.parse(block.body)


def check_xml(block: Block, _: Path) -> None:
    ElementTree.fromstring(f"<listing>{block.body}</listing>")


CHECKS: dict[str, Callable[[Block, Path], None]] = {
    "yaml": check_yaml,
    "python": check_python,
    "xml": check_xml,
}


@pytest.mark.parametrize(
    "block", [block for block in LISTINGS if block.kind not in RUN], ids=lambda block: block.name
)
def test_a_listing_is_valid(block: Block, folder: Path) -> None:
    CHECKS[block.kind](block, folder)


def test_the_older_format_becomes_the_newer_one() -> None:
    older, newer, _ = listings("docs/how-to/migrating.md", "yaml")
    assert migrate_source(SourceFile.of("arm.yaml", older), "key").text == newer


def test_the_listings_for_ci_are_those_of_a_new_workspace() -> None:
    templates = ROOT / "templates/workspace"
    parts = [part for part in listings("docs/how-to/ci.md", "yaml") if part.startswith(" ")]
    workflow = ".github/workflows/check.yaml.jinja"
    files = (workflow, ".pre-commit-config.yaml", workflow)
    for file, part in zip(files, parts, strict=True):
        assert part in (templates / file).read_text().replace("{{ stack }}", "my_robot")


def test_a_config_has_the_nodes_of_its_launch_file(folder: Path) -> None:
    page = "docs/how-to/from-launch-files.md"
    (launch_file,), (config,) = listings(page, "python"), listings(page, "yaml")
    outcome = compile_text(config, folder)
    assert outcome.plan is not None
    compiled = {process.node: process for process in outcome.plan.nodes}
    launched = nodes_of(launch_file)
    assert compiled.keys() == launched.keys()
    for name, node in launched.items():
        process: PlannedNode = compiled[name]
        assert (process.package, process.executable) == (node["package"], node["executable"])
        assert dict(process.env) == node.get("additional_env", {})
        assert (process.on_crash == "restart") == node.get("respawn", False)
        for parameters in node.get("parameters", ()):
            assert parameters.items() <= process.parameters.items()
        assert [*process.remappings] == node.get("remappings", [])


def nodes_of(launch_file: str) -> dict[str, Any]:
    """The arguments of each node, by its name."""
    calls = (node for node in ast.walk(ast.parse(launch_file)) if isinstance(node, ast.Call))
    nodes = (
        {str(keyword.arg): ast.literal_eval(keyword.value) for keyword in call.keywords}
        for call in calls
        if isinstance(call.func, ast.Name) and call.func.id == "LifecycleNode"
    )
    return {node["name"]: node for node in nodes}


def test_variables_hold_a_period(folder: Path) -> None:
    (part,) = (text for text in listings("docs/how-to/variants.md", "yaml") if "vars:" in text)
    text = (DUMMY / "dummy_new.yaml").read_text()
    assert "timer_period_sec: 0.001" in text
    plain, named = (
        compile_text(config, folder).plan
        for config in (
            text.replace("timer_period_sec: 0.001", "timer_period_sec: 0.002"),
            part + text.replace("timer_period_sec: 0.001", "timer_period_sec: *period"),
        )
    )
    assert plain is not None
    assert named is not None
    assert [p.parameters for p in named.nodes] == [p.parameters for p in plain.nodes]


@pytest.mark.parametrize("spelling", ["key", "seed"])
def test_the_watched_config_compiles_in_either_format(folder: Path, spelling: str) -> None:
    (config,) = listings("docs/how-to/safety.md", "yaml")
    text = migrate_source(SourceFile.of("watched.yaml", config), spelling).text  # type: ignore[arg-type]
    outcome = compile_text(text, folder)
    assert report_text(outcome.diagnostics, colour=False) == ""
    assert outcome.plan is not None
    (robot,) = (process for process in outcome.plan.nodes if process.section == "robot")
    assert "max_age_sec:0.1,stale_action:damp" in str(robot.parameters["sub_ctrl_setting"])


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ("max_age_sec: fast", "OBK103"),
        ("max_age_sec: 0", "OBK104"),
        ("max_age_sec: 0.019", "OBK213"),
        ("stale_action: zero", "OBK320"),
    ],
)
def test_a_finding_that_the_safety_page_names_is_found(
    folder: Path, change: str, code: str
) -> None:
    (config,) = listings("docs/how-to/safety.md", "yaml")
    key = change.partition(" ")[0]
    outcome = compile_text(re.sub(rf"{key} \S+", change, config), folder)
    assert [finding.code for finding in outcome.diagnostics] == [code]
    assert code in (ROOT / "docs/how-to/safety.md").read_text()


def test_every_stale_action_has_its_row() -> None:
    page = (ROOT / "docs/how-to/safety.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE)
    assert set(STALE_ACTIONS) <= set(rows)


def test_the_true_state_is_wired_as_the_page_has_it(folder: Path) -> None:
    (text,) = (t for t in listings("docs/reference/sensors.md", "yaml") if "robot:" in t)
    robot = yaml.safe_load(text)["robot"]
    outcome = compile_text(yaml.safe_dump(whole({"robot": robot})), folder)
    assert outcome.plan is not None, report_text(outcome.diagnostics, colour=False)
    (process,) = (one for one in outcome.plan.nodes if one.section == "robot")
    (publisher,), (timer,) = robot["publishers"], robot["timers"]
    assert publisher["topic"] in str(process.parameters["pub_true_sim_state_setting"])
    assert str(timer["timer_period_sec"]) in str(process.parameters["timer_true_sim_state_setting"])


def test_every_message_of_sensors_has_its_frames() -> None:
    _, _, section = (ROOT / "docs/reference/sensors.md").read_text().partition("## Frames")
    table, _, _ = section.partition("## ")
    listed = {
        name
        for row in re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)
        for name in re.findall(r"`(\w+)`", row)
    }
    posed = {name for name, rule in SENSOR_GROUPS.items() if rule.takes}
    assert posed - listed == {"ObkForceSensor", "ObkImage"}, "they have sections of their own"
