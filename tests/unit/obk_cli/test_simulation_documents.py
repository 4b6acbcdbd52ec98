"""The pages on the simulated robot and on viewers: `obk validate` finds nothing in their YAML."""

import re
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from obk_cli.compiler import Options, compile_source
from obk_cli.diagnostics.source import SourceFile
from obk_cli.report.text import report_text
from obk_cli.workspace.environment import MachineEnvironment

ROOT = Path(__file__).parents[3]
DUMMY = ROOT / "examples/dummy"
PAGES = ("reference/sensors.md", "how-to/viewing.md")
FOUND = {
    page: re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL)
    for page in PAGES
}
LISTINGS = [
    pytest.param(listing, id=f"{page}-{number}")
    for page, listings in FOUND.items()
    for number, listing in enumerate(listings)
]
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


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The dummy's folder, with a model that has what the pages name."""
    shutil.copytree(DUMMY, tmp_path, dirs_exist_ok=True)
    model = (DUMMY / "dummy.xml").read_text()
    keyframes = '<keyframe><key name="ic"/><key name="home"/></keyframe>'
    model = re.sub(r"<keyframe>.*</keyframe>", keyframes, model, flags=re.DOTALL)
    model = model.replace("</worldbody>", IN_THE_WORLD).replace("</sensor>", SENSORS)
    (tmp_path / "dummy.xml").write_text(model)
    return tmp_path


def with_listing(stack: dict[str, Any], listing: Any) -> dict[str, Any]:
    """The stack with more sensor groups, or with more in its robot."""
    robot = stack["robot"]
    if isinstance(listing, dict) and "robot" in listing:
        more = listing["robot"][0] if isinstance(listing["robot"], list) else listing["robot"]
        sim = {**robot["sim"], **more.get("sim", {})}
        params = {**robot["params"], **more.get("params", {})}
        return {**stack, "robot": {**robot, **more, "sim": sim, "params": params}}
    groups = listing["sensor_settings"] if isinstance(listing, dict) else listing
    robot["sim"]["sensor_settings"] += groups
    return stack


def test_both_pages_have_listings() -> None:
    assert all(FOUND.values())


@pytest.mark.parametrize("listing", LISTINGS)
def test_the_listing_is_sound(listing: str, folder: Path) -> None:
    stack = yaml.safe_load((DUMMY / "dummy_new.yaml").read_text())
    text = yaml.safe_dump(with_listing(stack, yaml.safe_load(listing)))
    environment = MachineEnvironment(folder, folder, {})
    options = Options(variables={}, working_folder=folder, environment=environment)
    outcome = compile_source(SourceFile.of(str(folder / "dummy.yaml"), text), options)
    assert outcome.plan is not None
    told = [finding for finding in outcome.diagnostics if finding.severity != "info"]
    assert report_text(tuple(told), colour=False) == ""
