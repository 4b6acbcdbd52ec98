"""One parameter file for all nodes: ROS's own parser gives each node its own values."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from obk_cli.compiler import Options, compile_config
from obk_cli.emit.launch_file import emit_launch_file
from obk_cli.emit.params import emit_params
from obk_cli.plan.plan import Origin, Plan, PlannedNode

READ = """
import json, sys, rclpy
from rclpy.node import Node
rclpy.init(args=["--ros-args", "--params-file", sys.argv[1]])
node = Node(sys.argv[2], automatically_declare_parameters_from_overrides=True)
print(json.dumps({name: node.get_parameter(name).value for name in sys.argv[3:]}))
node.destroy_node()
rclpy.shutdown()
"""


def read_by_ros(path: Path, process: PlannedNode) -> dict[str, object]:
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path), process.node, *process.parameters],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    values: dict[str, object] = json.loads(done.stdout)
    return values


@pytest.mark.ros
def test_each_node_of_the_example_reads_its_values_from_the_common_file(
    repository: Path, tmp_path: Path
) -> None:
    options = Options(variables={}, working_folder=repository, ignore=("OBK4",))
    plan = compile_config(str(repository / "examples/dummy/dummy.yaml"), options).plan
    assert plan is not None
    path = tmp_path / "dummy.params.yaml"
    path.write_text(emit_params(plan.nodes), encoding="utf-8")
    for process in plan.nodes:
        assert read_by_ros(path, process) == process.parameters


@pytest.mark.ros
def test_the_launch_files_parameters_are_read_equally(tmp_path: Path) -> None:
    origin = Origin(path="f", line=1, column=1)
    joystick, robot = (
        PlannedNode(
            node=name,
            namespace="/",
            section="robot",
            device="onboard",
            package="demo",
            executable="run",
            origin=origin,
            parameters=parameters,
        )
        for name, parameters in (("joystick", {}), ("arm", {"quotes": "a'''b\"\\\n"}))
    )
    text = emit_launch_file(Plan(name="arm", nodes=(joystick, robot)))
    names: dict[str, str] = {}
    start = text.index("PARAMETERS = ")
    exec(text[start : text.index("def ", start)], names)  # type: ignore[arg-type]
    path = tmp_path / "arm.params.yaml"
    path.write_text(names["PARAMETERS"], encoding="utf-8")
    assert read_by_ros(path, robot) == robot.parameters
