"""`obk new robot`: a driver with the joints of the simulated robot that it replaces."""

import ast
import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
import typer

from obelisk_spec.model import ActuatorFact, ModelFacts, SensorFact
from obk_cli.cli.init import command
from obk_cli.cli.new import app
from obk_cli.scaffold.robot_model import robot_joints

from ....robot_models import CART  # noqa: TID252 - shared by folders of tests
from .new_command import printed_by

EXAMPLES = Path(__file__).resolve().parents[4] / "examples"
REPLACING = ("--replace", "obelisk_robot_0")

init = typer.Typer()
init.command()(command)
obk_init = partial(printed_by, init)
obk_new = partial(printed_by, app)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def constants(node: str) -> dict[str, object]:
    """The constants of the generated module."""
    text = Path(f"src/{node}/{node}/{node}.py").read_text()
    return {
        statement.targets[0].id: ast.literal_eval(statement.value)
        for statement in ast.parse(text).body
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name)
    }


def run_in_package(node: str, test: str) -> None:
    """Run a test next to those of the package."""
    Path(f"src/{node}/test/test_more.py").write_text(test)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"src/{node}"],
        env=os.environ
        | {"ROS_LOG_DIR": str(Path.cwd() / "log"), "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


HOLDS = """
from obelisk_control_msgs.msg import PositionSetpoint


def test_torques_do_not_move_the_joints(stack):
    trial = stack("foo.yaml")
    trial.publish("/test/ctrl", PositionSetpoint(u_mujoco=[5.0, 5.0, 5.0]))
    run = trial.run(0.1)
    assert not run.faults
    for msg in run["/test/obk_joint_encoders"].messages:
        assert list(msg.joint_names) == ["shoulder", "elbow", "wrist"]
        assert list(msg.joint_pos) == [0.4, -0.8, 0.4]
        assert list(msg.joint_vel) == [0.0, 0.0, 0.0]
"""


@pytest.mark.ros
@pytest.mark.mujoco
def test_torques_are_no_positions(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    obk_init("arm")
    monkeypatch.chdir(here / "arm")
    obk_new("robot", "foo", "--add-to", "arm.yaml", *REPLACING)
    assert constants("foo")["JOINTS"] == {"shoulder": 0.4, "elbow": -0.8, "wrist": 0.4}
    run_in_package("foo", HOLDS)


FOLLOWS = """
from obelisk_control_msgs.msg import PDFeedForward


def test_the_joints_follow_their_targets(stack):
    trial = stack("foo.yaml")
    trial.publish("/test/ctrl", PDFeedForward(joint_names=["slide"], pos_target=[0.5]))
    run = trial.run(0.1)
    assert not run.faults
    for msg in run["/test/obk_joint_encoders"].messages:
        assert list(msg.joint_names) == ["slide", "hinge"]
    assert list(msg.joint_pos) == [0.5, 0.0]
"""


@pytest.mark.ros
@pytest.mark.mujoco
def test_positions_are_those_of_messages_with_gains(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "given.xml").write_text(CART)
    obk_init("cart", "--model", "given.xml")
    monkeypatch.chdir(here / "cart")
    obk_new("robot", "foo", "--add-to", "cart.yaml", *REPLACING)
    run_in_package("foo", FOLLOWS)


SERVOS = """
from obelisk_control_msgs.msg import PositionSetpoint


def test_the_joint_follows_its_servo(stack):
    trial = stack("foo.yaml")
    trial.publish("/test/ctrl", PositionSetpoint(u_mujoco=[0.5]))
    run = trial.run(0.1)
    assert list(run["/test/joint_encoders"].messages[-1].y) == [0.5]


def test_a_wrong_number_of_controls_is_a_fault(stack):
    trial = stack("foo.yaml")
    trial.publish("/test/ctrl", PositionSetpoint(u_mujoco=[0.5, 0.5]))
    (fault,) = trial.run(0.1).faults
    assert "u_mujoco" in str(fault)
"""


@pytest.mark.ros
@pytest.mark.mujoco
def test_controls_of_servos_are_positions(here: Path) -> None:
    shutil.copytree(EXAMPLES / "dummy", here, dirs_exist_ok=True)
    (here / "src").mkdir()
    obk_new("robot", "foo", "--add-to", "dummy_new.yaml", *REPLACING)
    assert constants("foo")["JOINTS"] == {"joint1": 0.5}
    run_in_package("foo", SERVOS)


@pytest.mark.mujoco
def test_without_a_config_the_joints_are_those_of_the_workspaces_model(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    obk_init("arm")
    monkeypatch.chdir(here / "arm")
    obk_new("robot", "foo")
    assert constants("foo")["JOINTS"] == {"shoulder": 0.4, "elbow": -0.8, "wrist": 0.4}


def test_without_a_model_there_is_one_joint_to_edit(here: Path) -> None:
    (here / "src").mkdir()
    obk_new("robot", "foo")
    assert constants("foo")["JOINTS"] == {"joint": 0.0}
    obk_new("robot", "bar", "--sensor-msg", "ObkImu")
    assert "JOINTS" not in constants("bar")


FACTS = ModelFacts(
    sensors={
        f"{joint}_pos": SensorFact(
            name=f"{joint}_pos", type="jointpos", object_type="joint", object_name=joint
        )
        for joint in "abc"
    },
    joints=dict.fromkeys("abc", "hinge") | {"base": "free"},
    keyframes=("home",),
    poses={"": {"a": 0.0, "b": 0.0, "c": 0.0}, "home": {"a": 1.0, "b": 2.0, "c": 3.0}},
    actuators=(
        ActuatorFact(name="", unit="rad", joint="b"),
        ActuatorFact(name="", unit="rad", joint="a"),
    ),
)


def test_the_joints_have_the_order_of_the_encoders() -> None:
    found = robot_joints(FACTS, "home", ("c_pos", "a_pos"))
    assert found is not None
    assert list(found.start.items()) == [("c", 3.0), ("a", 1.0)]
    assert (found.driven, found.are_servos) == (("b", "a"), True)


def test_without_encoders_the_driven_joints_are_first() -> None:
    found = robot_joints(FACTS, "ic")
    assert found is not None
    assert list(found.start.items()) == [("b", 0.0), ("a", 0.0), ("c", 0.0)]


def test_a_model_without_joints_gives_none() -> None:
    assert robot_joints(ModelFacts(), "") is None
