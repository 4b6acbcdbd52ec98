"""Workspaces written for each generation of Obelisk's API run unchanged.

Each has two controllers, an estimator, a robot, a simulator, a message package and a C++ package
that is declared but not built.
"""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from obk_cli.cli.main import main

from .stack import launched, obk

Capture = pytest.CaptureFixture[str]

WORKSPACES = Path(__file__).resolve().parents[1] / "workspaces"
GENERATIONS = ("g1", "g2", "g3")


@pytest.fixture(params=GENERATIONS)
def workspace(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Return a copy of a generation's workspace."""
    copy = tmp_path / str(request.param)
    shutil.copytree(WORKSPACES / str(request.param), copy)
    return copy


def run(capsys: Capture, *arguments: object) -> tuple[object, str]:
    """Run `obk` in this process; return its exit code and output."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return ended.value.code, capsys.readouterr().out


def findings(config: Path, capsys: Capture) -> list[dict[str, Any]]:
    """Return the errors and warnings of a config."""
    _, printed = run(capsys, "validate", config, "--format", "json")
    report = json.loads(printed)
    return [found for found in report["diagnostics"] if found["severity"] != "info"]


@pytest.mark.parametrize("config", ["lab_simulated.yaml", "lab_hardware.yaml"])
def test_it_has_no_findings(workspace: Path, config: str, capsys: Capture) -> None:
    assert findings(workspace / "config" / config, capsys) == []


def test_a_cpp_package_that_is_not_built_is_the_only_finding(
    workspace: Path, capsys: Capture
) -> None:
    (found,) = findings(workspace / "config" / "lab_cpp.yaml", capsys)
    assert (found["code"], found["severity"]) == ("OBK402", "error")
    assert "colcon build --packages-select lab_cpp" in found["help"]


@pytest.mark.parametrize("config", ["lab_simulated.yaml", "lab_hardware.yaml"])
def test_the_other_format_has_the_same_parameters(
    workspace: Path, config: str, capsys: Capture
) -> None:
    original = workspace / "config" / config
    before = parameters(original, capsys)
    for spelling in ("key", "seed"):
        assert run(capsys, "migrate", original, "--to", spelling, "--write")[0] == 0
        assert parameters(original, capsys) == before


def parameters(config: Path, capsys: Capture) -> dict[str, list[Any]]:
    """Return topic, message type and period of every component, by node."""
    code, printed = run(capsys, "compile", config, "--to", "params")
    assert code == 0
    nodes = yaml.safe_load(printed)
    settings = {
        name: yaml.safe_load(node["ros__parameters"]["obelisk_settings"])
        for name, node in nodes.items()
    }
    kept = ("topic", "msg_type", "timer_period_sec")
    return {
        name: [
            (kind, *(component.get(key) for key in kept))
            for kind in ("publishers", "subscribers", "timers")
            for component in given.get(kind, ())
        ]
        for name, given in settings.items()
    }


@pytest.mark.ros
@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize(
    "workspace",
    [*(pytest.param(name, marks=pytest.mark.slow) for name in GENERATIONS[:-1]), GENERATIONS[-1]],
    indirect=True,
)
def test_it_builds_launches_and_moves(workspace: Path) -> None:
    built = obk("build", "--workspace", workspace)
    assert built.returncode == 0, built.stderr
    for config in ("lab_simulated.yaml", "lab_hardware.yaml"):
        with launched(workspace / "config" / config) as run:
            run.wait_for_line("the joint has moved")
        assert run.process.returncode == 0, run.text
        assert run.left_over() == []
