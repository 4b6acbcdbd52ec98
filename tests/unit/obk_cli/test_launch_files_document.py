"""docs/how-to/from-launch-files.md has one stack twice: the launch file and the config agree."""

import ast
import re
import shutil
from pathlib import Path

import pytest

from obk_cli.compiler import Options, compile_source
from obk_cli.diagnostics.source import SourceFile
from obk_cli.plan.plan import Process
from obk_cli.report.text import report_text
from obk_cli.workspace.environment import MachineEnvironment

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs/how-to/from-launch-files.md").read_text()
(LAUNCH_FILE,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
(CONFIG,) = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)


def launched() -> dict[str, dict[str, object]]:
    """What the launch file says of each node, by its name."""
    calls = (node for node in ast.walk(ast.parse(LAUNCH_FILE)) if isinstance(node, ast.Call))
    nodes = (
        {str(keyword.arg): ast.literal_eval(keyword.value) for keyword in call.keywords}
        for call in calls
        if isinstance(call.func, ast.Name) and call.func.id == "LifecycleNode"
    )
    return {node["name"]: node for node in nodes}


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Process]:
    folder = tmp_path_factory.mktemp("stack")
    shutil.copytree(ROOT / "examples/dummy", folder, dirs_exist_ok=True)
    environment = MachineEnvironment(folder, folder, {})
    options = Options(variables={}, working_folder=folder, environment=environment)
    outcome = compile_source(SourceFile.of(str(folder / "arm.yaml"), CONFIG), options)
    assert report_text(outcome.diagnostics, colour=False) == ""
    assert outcome.plan is not None
    return {process.node: process for process in outcome.plan.processes}


@pytest.mark.mujoco
def test_the_config_has_the_nodes_of_the_launch_file(compiled: dict[str, Process]) -> None:
    assert set(compiled) == set(launched())
    for name, node in launched().items():
        process = compiled[name]
        assert (process.package, process.executable) == (node["package"], node["executable"])
        assert dict(process.env) == node.get("additional_env", {})
        assert (process.on_crash == "restart") == node.get("respawn", False)
        for parameters in node.get("parameters", ()):
            assert parameters.items() <= process.parameters.items()
        assert [*process.remappings] == node.get("remappings", [])
