from pathlib import Path

from obk_cli.check.context import CheckContext
from obk_cli.check.simulation import check_models
from obk_cli.config.locate import locate_files
from obk_cli.config.reader import read_stack
from obk_cli.config.topology import Topology
from obk_cli.config.yaml_parser import parse_source
from obk_cli.diagnostics.source import SourceFile

from ..nowhere import Nowhere  # noqa: TID252 - shared by folders of tests

GROUP = "{topic: /q, dt: 1, msg_type: ObkImu, sensor_names: {a: gyro, b: gyro}}"
CONFIG = f"""\
robot:
  pkg: demo
  executable: sim
  sim: {{model_xml_path: arm.xml, sensor_settings: [{GROUP}]}}
"""


def test_without_mujoco_model_checks_are_reported_as_skipped(
    tmp_path: Path,
) -> None:
    (tmp_path / "arm.xml").touch()
    parsed = parse_source(SourceFile.of("f.yaml", CONFIG))
    assert parsed.tree is not None
    stack, _ = read_stack(parsed.tree)
    assert stack is not None
    environment = Nowhere()
    stack = locate_files(stack, tmp_path, environment)
    context = CheckContext(stack=stack, topology=Topology.of(stack), environment=environment)
    faults = check_models(context)
    assert [str(fault) for fault in faults] == [
        "f.yaml:4:89: info[OBK307]: `ObkImu` has no `accelerometer` sensor, so the fields for it "
        "are not filled in",
        "f.yaml:4:113: error[OBK306]: `ObkImu` takes 1 `gyro` sensor, but has 2",
        "f.yaml:4:89: info[OBK307]: `ObkImu` has no `framequat` sensor, so the fields for it are "
        "not filled in",
        "f.yaml:4:25: info[OBK300]: MuJoCo is not installed, so names are not checked against the "
        "model",
    ]
