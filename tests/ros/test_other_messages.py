"""A workspace that builds message packages with Obelisk's names, from another release."""

import re
import shutil
from pathlib import Path

import pytest

from .stack import calm, obk
from .workspace import write_files

pytestmark = [pytest.mark.ros, pytest.mark.mujoco, pytest.mark.timeout(600)]

INTERFACES = Path(__file__).resolve().parents[2] / "interfaces"
LACKING = ("JointEncoders", "ObkImu")
CMAKE = """
find_package(builtin_interfaces REQUIRED)
rosidl_generate_interfaces(${PROJECT_NAME}
  "msg/ObkImage.msg"
  DEPENDENCIES obelisk_std_msgs
)
"""
IMU = """
          - topic: /my_robot/imu
            dt: 0.1
            msg_type: ObkImu
            sensor_names: {hand_acc: accelerometer}
"""


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A new workspace, with an `obelisk_sensor_msgs` that lacks two messages and a field."""
    monkeypatch.chdir(tmp_path)
    assert obk("init", "my_robot").returncode == 0
    folder = tmp_path / "my_robot"
    calm(folder)
    package = folder / "src/obelisk_sensor_msgs"
    shutil.copytree(INTERFACES / "obelisk_sensor_msgs", package)
    for name in LACKING:
        (package / "msg" / f"{name}.msg").unlink()
    state = package / "msg/TrueSimState.msg"
    state.write_text(re.sub(r"^float64\[\] y$", "", state.read_text(), flags=re.MULTILINE))
    manifest = package / "package.xml"
    manifest.write_text(re.sub(r"<depend>.*?</depend>", "", manifest.read_text()))
    write_files(package, {"CMakeLists.txt": CMAKE})
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.slow
def test_a_stack_runs_on_messages_that_lack_types_it_does_not_use(workspace: Path) -> None:
    checked = obk("validate", "my_robot.yaml", "--verbose")
    assert checked.returncode == 0, checked.stdout
    assert "info[OBK413]" in checked.stdout
    for lacking in ("JointEncoders", "ObkImu", "TrueSimState.y"):
        assert f"`{lacking}`" in checked.stdout
    built = obk("build")
    assert built.returncode == 0, built.stderr
    run = obk("launch", "my_robot.yaml", "--duration", "2")
    assert run.returncode == 0, run.stdout + run.stderr
    assert "Traceback" not in run.stdout


@pytest.mark.slow
def test_a_missing_type_is_named_with_its_use(workspace: Path) -> None:
    config = workspace / "my_robot.yaml"
    text = config.read_text()
    assert "sensor_settings:" in text
    config.write_text(re.sub(r"(?<=sensor_settings:)\n", IMU, text))
    checked = obk("validate", "my_robot.yaml")
    assert re.search(r"^my_robot\.yaml:\d+:\d+: warning\[OBK413\]", checked.stdout, re.MULTILINE)
    run = obk("launch", "my_robot.yaml", "--duration", "2")
    assert run.returncode == 1
    (failed,) = (line for line in run.stdout.splitlines() if line.startswith("failed: "))
    assert "`ObkImu`" in failed
    assert str(workspace / ".obk") in run.stdout
    assert "Traceback" not in run.stdout
