"""docs/reference/sensors.md says what is true: its configs and its table of frames."""

import re
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from obelisk_spec.sensors import SENSOR_GROUPS
from obelisk_spec.sim_checks import check_sim
from obk_cli.compiler import Options, compile_source
from obk_cli.diagnostics.source import SourceFile
from obk_cli.report.text import report_text
from obk_cli.workspace.environment import MachineEnvironment

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs/reference/sensors.md").read_text()
BLOCKS = [yaml.safe_load(block) for block in re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)]


def groups() -> list[dict[str, Any]]:
    """The sensor groups, with the key above them and without."""
    lists = (block if isinstance(block, list) else block.get("sensor_settings") for block in BLOCKS)
    return [group for listed in lists for group in listed or ()]


def test_the_sensor_groups_are_without_a_finding() -> None:
    found = check_sim({"model_xml_path": "m", "sensor_settings": groups()}, {}, None)
    assert found == ()
    assert len(groups()) == 4


@pytest.mark.mujoco
def test_the_components_of_the_true_state_are_taken(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "examples/dummy", tmp_path, dirs_exist_ok=True)
    (robot,) = (block["robot"] for block in BLOCKS if isinstance(block, dict) and "robot" in block)
    config = yaml.safe_load((tmp_path / "dummy_new.yaml").read_text())
    config["robot"] |= {key: robot[key] for key in ("publishers", "timers")}
    text = yaml.safe_dump(config)
    environment = MachineEnvironment(tmp_path, tmp_path, {})
    options = Options(variables={}, working_folder=tmp_path, environment=environment)
    outcome = compile_source(SourceFile.of(str(tmp_path / "true.yaml"), text), options)
    assert outcome.plan is not None, report_text(outcome.diagnostics, colour=False)
    (process,) = (one for one in outcome.plan.processes if one.section == "robot")
    (publisher,), (timer,) = robot["publishers"], robot["timers"]
    assert publisher["topic"] in str(process.parameters["pub_true_sim_state_setting"])
    assert str(timer["timer_period_sec"]) in str(process.parameters["timer_true_sim_state_setting"])


def test_every_message_of_sensors_has_its_frames() -> None:
    _, _, section = TEXT.partition("## Frames")
    table, _, _ = section.partition("## ")
    listed = {
        name
        for row in re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)
        for name in re.findall(r"`(\w+)`", row)
    }
    posed = {name for name, rule in SENSOR_GROUPS.items() if rule.takes}
    assert posed - listed == {"ObkForceSensor", "ObkImage"}, "they have sections of their own"
