"""docs/how-to/safety.md says what is true: its config and its tables."""

import re
import shutil
from pathlib import Path

import pytest

from obelisk_spec.components import STALE_ACTIONS
from obk_cli.compiler import Options, Outcome, compile_source
from obk_cli.configedit.migrate import migrate_source
from obk_cli.diagnostics.source import SourceFile
from obk_cli.report.text import report_text
from obk_cli.workspace.environment import MachineEnvironment

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs/how-to/safety.md").read_text()
(CONFIG,) = re.findall(r"```yaml\n(config: .*?)```", TEXT, re.DOTALL)


def compile_text(text: str, folder: Path) -> Outcome:
    shutil.copytree(ROOT / "examples/dummy", folder, dirs_exist_ok=True)
    environment = MachineEnvironment(folder, folder, {})
    options = Options(variables={}, working_folder=folder, environment=environment)
    return compile_source(SourceFile.of(str(folder / "watched.yaml"), text), options)


@pytest.mark.mujoco
@pytest.mark.parametrize("spelling", ["key", "seed"])
def test_the_config_is_without_a_finding_in_either_spelling(tmp_path: Path, spelling: str) -> None:
    text = migrate_source(SourceFile.of("watched.yaml", CONFIG), spelling).text  # type: ignore[arg-type]
    outcome = compile_text(text, tmp_path)
    assert report_text(outcome.diagnostics, colour=False) == ""
    assert outcome.plan is not None
    (robot,) = (process for process in outcome.plan.processes if process.section == "robot")
    assert "max_age_sec: 0.1, stale_action: damp" in str(robot.parameters["sub_ctrl_setting"])


@pytest.mark.mujoco
def test_what_the_document_says_is_found_is_found(tmp_path: Path) -> None:
    for change, code in (
        ("max_age_sec: fast", "OBK103"),
        ("max_age_sec: 0", "OBK104"),
        ("max_age_sec: 0.019", "OBK213"),
        ("stale_action: zero", "OBK320"),
    ):
        key = change.partition(" ")[0]
        outcome = compile_text(re.sub(rf"{key} \S+", change, CONFIG), tmp_path)
        assert [fault.code for fault in outcome.diagnostics] == [code]
        assert code in TEXT


def test_every_action_has_its_row() -> None:
    _, _, section = TEXT.partition("## What is done")
    table, _, _ = section.partition("**Zero is a command.**")
    assert tuple(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)[1:]) == STALE_ACTIONS
