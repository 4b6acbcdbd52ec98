"""The pre-commit hook and the GitHub action that other repositories use."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

CASES = Path(__file__).parents[2] / "cases"
VALID_CONFIG = CASES / "accept/OBK004/topic_twice.yaml"
FAULTY = CASES / "reject/OBK203/dangling.yaml"


@pytest.fixture
def steps(repository: Path) -> list[dict[str, Any]]:
    """The steps of the action."""
    action = yaml.safe_load((repository / "action.yml").read_text())
    assert action["runs"]["using"] == "composite"
    return list(action["runs"]["steps"])


def environment(tmp_path: Path, **variables: str) -> dict[str, str]:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    made = {"RUNNER_TEMP": str(tmp_path), "GITHUB_OUTPUT": str(tmp_path / "outputs")}
    return {**os.environ, "PATH": path, **made, **variables}


def check(
    steps: list[dict[str, Any]], tmp_path: Path, configs: str, arguments: str = "--ignore OBK4"
) -> subprocess.CompletedProcess[str]:
    """Run the checking step, as GitHub would."""
    script = next(step["run"] for step in steps if step.get("id") == "validate")
    return subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", script],
        env=environment(tmp_path, CONFIGS=configs, ARGUMENTS=arguments),
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_action_keeps_and_annotates_the_findings_and_fails_by_them(
    steps: list[dict[str, Any]], tmp_path: Path
) -> None:
    done = check(steps, tmp_path, f"{VALID_CONFIG} {FAULTY}")
    assert done.returncode == 1
    assert done.stdout.startswith(f"::error file={FAULTY},line=25,")
    findings = json.loads((tmp_path / "obk.sarif").read_text())["runs"][0]["results"]
    assert [finding["ruleId"] for finding in findings] == ["OBK203"]
    assert (tmp_path / "outputs").read_text() == f"sarif={tmp_path / 'obk.sarif'}\n"


def test_the_action_passes_valid_configs(steps: list[dict[str, Any]], tmp_path: Path) -> None:
    done = check(steps, tmp_path, f"{VALID_CONFIG.parent}/topic_tw*.yaml")
    assert (done.returncode, done.stdout) == (0, "")
    assert json.loads((tmp_path / "obk.sarif").read_text())["runs"][0]["results"] == []


def test_the_action_uploads_nothing_if_nothing_could_be_checked(
    steps: list[dict[str, Any]], tmp_path: Path
) -> None:
    done = check(steps, tmp_path, str(VALID_CONFIG), "--ignore OBK9")
    assert done.returncode == 2
    assert "`--ignore OBK9`: unknown rule" in done.stderr
    assert not (tmp_path / "outputs").exists()


def test_inputs_of_the_action_are_never_a_part_of_a_script(
    steps: list[dict[str, Any]],
) -> None:
    assert [step for step in steps if "${{" in step.get("run", "")] == []


def test_the_hook_checks_the_given_files(repository: Path, tmp_path: Path) -> None:
    (hook,) = yaml.safe_load((repository / ".pre-commit-hooks.yaml").read_text())
    command = [*hook["entry"].split(), str(FAULTY)]
    done = subprocess.run(
        command, env=environment(tmp_path), capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "error[OBK203]" in done.stdout


def test_the_action_takes_no_library_out_of_the_checkout(steps: list[dict[str, Any]]) -> None:
    scripts = [step["run"] for step in steps if "python" in step.get("run", "")]
    assert scripts
    assert all(script.startswith("python -P -m pip ") for script in scripts)


def test_the_name_of_a_config_is_not_an_option(steps: list[dict[str, Any]], tmp_path: Path) -> None:
    done = check(steps, tmp_path, "--help")
    assert done.returncode == 1
    assert done.stdout.startswith("::error file=--help,")
