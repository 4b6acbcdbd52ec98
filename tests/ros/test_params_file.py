"""A parameter file, read by ROS's own parser, gives a node the intended values."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from obelisk_spec.values import ParameterValue
from obk_cli.emit.params import emit_params
from obk_cli.plan.plan import Origin, PlannedNode

NODE = """
import json, sys, rclpy
from rclpy.node import Node
rclpy.init(args=["--ros-args", "--params-file", sys.argv[1]])
node = Node("arm", namespace="left", automatically_declare_parameters_from_overrides=True)
values = {name: p.value for name, p in node._parameters.items() if name in sys.argv[2:]}
print(json.dumps({n: v if isinstance(v, str) or not hasattr(v, "__len__") else list(v)
                  for n, v in values.items()}))
node.destroy_node()
rclpy.shutdown()
"""

PARAMETERS: dict[str, ParameterValue] = {
    "flag": True,
    "count": 3,
    "whole": 1.0,
    "tiny": 1e-7,
    "on": "on",
    "digits": "012",
    "exponent": "1e3",
    "quoted": 'say "hi" \\ there\nagain \u2028 ä😀',
    "setting": '{"topic": "/x", "on": [1, 2.5], "key": "a: b", "path": "it\'s \\\\ ä"}',
    "gains.kp": (1.0, 2.5),
    "names": ("a", "1", "true"),
    "flags": (True, False),
    "counts": (1, 2),
}


def read_by_ros(path: Path, names: list[str]) -> dict[str, object]:
    done = subprocess.run(
        [sys.executable, "-c", NODE, str(path), *names],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    values: dict[str, object] = json.loads(done.stdout)
    return values


def process(parameters: dict[str, ParameterValue]) -> PlannedNode:
    return PlannedNode(
        node="arm",
        namespace="/left",
        section="robot",
        device="onboard",
        package="demo",
        executable="arm",
        origin=Origin(path="f", line=1, column=1),
        parameters=parameters,
    )


@pytest.mark.ros
def test_ros_reads_the_values_that_were_written(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(emit_params([process(PARAMETERS)]), encoding="utf-8")
    read = read_by_ros(path, list(PARAMETERS))
    wanted = {n: list(v) if isinstance(v, tuple) else v for n, v in PARAMETERS.items()}
    assert read == wanted
    assert {n: type(v) for n, v in read.items()} == {n: type(v) for n, v in wanted.items()}


@pytest.mark.ros
def test_ros_takes_the_file_of_a_node_without_parameters(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(emit_params([process({})]), encoding="utf-8")
    assert read_by_ros(path, []) == {}
