"""`obk init --model`: a workspace for a robot's model."""

import json
import struct
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import typer

from obk_cli.cli.init import command
from obk_cli.compiler import Options, compile_config
from obk_cli.errors import CommandFailedError

from ....robot_models import BOX, CART, MIXED, MUSCLE, PENDULUM_URDF, TETRAHEDRON  # noqa: TID252 - shared by folders of tests
from .new_command import error_of, printed_by

Tree = Callable[[Path], dict[str, bytes]]

pytestmark = pytest.mark.mujoco
app = typer.Typer()
app.command()(command)
obk_init = partial(printed_by, app)
refused = partial(error_of, app)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def findings(config: str) -> list[str]:
    options = Options(variables={}, working_folder=Path.cwd(), for_test=True)
    outcome = compile_config(config, options)
    # The simulator's package exists only if the tool is installed.
    return [str(d) for d in outcome.diagnostics if "`obelisk_sim_py`" not in str(d)]


def package_with_urdf(folder: Path) -> Path:
    """A ROS package with a robot whose collision mesh is named by the package."""
    (folder / "urdf").mkdir(parents=True)
    (folder / "meshes").mkdir()
    (folder / "meshes/rod.stl").write_bytes(TETRAHEDRON)
    (folder / "package.xml").write_text("<package><name>pendulum</name></package>")
    (folder / "urdf/pendulum.urdf").write_text(PENDULUM_URDF)
    return folder / "urdf/pendulum.urdf"


@pytest.mark.parametrize(
    ("model", "message"),
    [(CART, "PDFeedForward"), (MIXED, "PositionSetpoint"), (MUSCLE, "PositionSetpoint")],
)
def test_the_workspace_is_valid_without_a_finding(here: Path, model: str, message: str) -> None:
    (here / "given.xml").write_text(model)
    obk_init("robot", "--model", "given.xml")
    assert findings("robot/robot.yaml") == []
    assert (here / "robot/robot.yaml").read_text().count(f"msg_type: {message}}}") == 2
    assert (here / "robot/model/given.xml").read_text() == model


@pytest.mark.slow
def test_the_code_of_the_workspace_passes_ruff_and_mypy(here: Path, mypy_cache: Path) -> None:
    (here / "given.xml").write_text(MIXED)
    obk_init("robot", "--model", "given.xml")
    for arguments in (
        ("ruff", "check", "--no-cache", "."),
        ("ruff", "format", "--no-cache", "--check", "."),
        ("mypy", "--cache-dir", str(mypy_cache)),
    ):
        done = subprocess.run(
            [sys.executable, "-m", *arguments],
            cwd=here / "robot",
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr


def test_a_urdf_is_converted_to_mjcf_with_motors_encoders_and_its_meshes(here: Path) -> None:
    urdf = package_with_urdf(here / "checkout")
    obk_init("robot", "--model", str(urdf))
    assert findings("robot/robot.yaml") == []
    assert (here / "robot/model/assets/rod.stl").read_bytes() == TETRAHEDRON
    added = (here / "robot/model/robot.xml").read_text()
    assert '<include file="pendulum.xml"/>' in added
    assert '<motor name="swing_motor" joint="swing"/>' in added
    assert '<jointvel name="swing_vel" joint="swing"/>' in added


def test_meshes_of_one_name_come_from_the_packages_around(here: Path) -> None:
    urdf = package_with_urdf(here / "robots/pendulum")
    collision = '<geometry><mesh filename="package://pendulum/meshes/rod.stl"/></geometry>'
    other = collision.replace("package://pendulum", "package://hand")
    urdf.write_text(PENDULUM_URDF.replace(collision, f"{other}</collision><collision>{collision}"))
    package_with_urdf(here / "robots/hand")
    (here / "robots/hand/package.xml").write_text("<package><name>hand</name></package>")
    larger = TETRAHEDRON.replace(struct.pack("<f", 0.02), struct.pack("<f", 0.03))
    (here / "robots/hand/meshes/rod.stl").write_bytes(larger)
    obk_init("robot", "--model", str(urdf))
    assets = here / "robot/model/assets"
    assert {path.read_bytes() for path in assets.iterdir()} == {TETRAHEDRON, larger}
    assert findings("robot/robot.yaml") == []


def test_names_of_a_model_may_have_any_character(here: Path) -> None:
    text = CART.replace('"turning"', '"a: [b] # &quot;c&quot;"')
    for attribute in ("name", "joint"):
        text = text.replace(f'{attribute}="slide"', f'{attribute}="\'&quot;1"')
    (here / "given.xml").write_text(text)
    obk_init("robot", "--model", "given.xml")
    assert findings("robot/robot.yaml") == []


def test_only_missing_encoders_are_added_and_names_stay_unique(here: Path) -> None:
    sensors = '<sensor><jointpos name="at" joint="hinge"/><gyro name="hinge_vel" site="imu"/>'
    (here / "given.xml").write_text(CART.replace("<sensor>", sensors))
    obk_init("robot", "--model", "given.xml")
    added = (here / "robot/model/robot.xml").read_text()
    assert '"hinge_pos"' not in added
    assert '<jointvel name="hinge_vel_2" joint="hinge"/>' in added
    config = (here / "robot/robot.yaml").read_text()
    assert "at: jointpos" in config
    assert config.index("slide_pos: jointpos") < config.index("at: jointpos")  # driven ones first


def test_a_model_that_lacks_nothing_is_used_as_it_is(here: Path) -> None:
    obk_init("first")  # its arm has sensors for all joints, motors and the keyframe `home`
    obk_init("robot", "--model", "first/model/first.xml")
    assert [path.name for path in (here / "robot/model").iterdir()] == ["first.xml"]
    assert "ic_keyframe: home" in (here / "robot/robot.yaml").read_text()


def test_files_around_the_model_keep_their_places(here: Path) -> None:
    (here / "lab/meshes").mkdir(parents=True)
    (here / "lab/mjcf").mkdir()
    (here / "lab/meshes/box.stl").write_bytes(TETRAHEDRON)
    (here / "lab/mjcf/box.xml").write_text(BOX)
    (here / "lab/mjcf/scene.xml").write_text('<mujoco><include file="box.xml"/></mujoco>')
    obk_init("robot", "--model", "lab/mjcf/scene.xml")
    made = {p.relative_to("robot/model").as_posix() for p in Path("robot/model").rglob("*.*")}
    assert made == {"meshes/box.stl", "mjcf/box.xml", "mjcf/scene.xml", "mjcf/robot.xml"}
    assert findings("robot/robot.yaml") == []


def test_an_attached_model_is_copied_with_the_files_of_its_folder(here: Path) -> None:
    (here / "lab/box/meshes").mkdir(parents=True)
    (here / "lab/box/meshes/box.stl").write_bytes(TETRAHEDRON)
    named = BOX.replace("../meshes", "meshes").replace("<body>", '<body name="box">')
    (here / "lab/box/box.xml").write_text(named)
    (here / "lab/two.xml").write_text(
        '<mujoco><asset><model name="box" file="box/box.xml"/></asset><worldbody>'
        '<body name="base"><attach model="box" body="box" prefix="a_"/></body></worldbody></mujoco>'
    )
    obk_init("robot", "--model", "lab/two.xml")
    assert (here / "robot/model/box/meshes/box.stl").read_bytes() == TETRAHEDRON
    assert findings("robot/robot.yaml") == []


def test_the_json_result_contains_the_added_parts(here: Path) -> None:
    (here / "given.xml").write_text(CART)
    result = json.loads(obk_init("robot", "--model", "given.xml", "--format", "json"))
    assert len(result["notes"]) == 2
    assert "model/robot.xml" in result["notes"][0]


def test_repeating_the_command_changes_nothing(here: Path, tree: Tree) -> None:
    (here / "given.xml").write_text(MIXED)
    obk_init("robot", "--model", "given.xml")
    before = tree(here)
    obk_init("robot", "--model", "given.xml")
    assert tree(here) == before


XACRO = '<robot xmlns:x="http://www.ros.org/wiki/xacro"><x:property name="a" value="1"/></robot>'
UNSTABLE = MIXED.replace('kv="0.2"', 'kv="1e6"')


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("[project]\n", "MuJoCo cannot read this file as a model"),
        ("<mujoco>\n<worldbody>\n</mujoco>", "given.xml:"),
        ("<html/>", "MuJoCo cannot read this file as a model"),
        ("<mujoco/>", "no hinge or slide joint with a name"),
        ("<mujoco><option timestep='0'/></mujoco>", "its time step is 0 s"),
        (BOX, "a file of the model is missing: `../meshes/box.stl`"),
        (BOX.replace("../meshes", "/meshes"), "missing: `/meshes/box.stl`"),
        (UNSTABLE, "cannot be simulated: it diverges"),
        (PENDULUM_URDF, "missing: `package://pendulum/meshes/rod.stl`"),
        (XACRO, "is a xacro file"),
    ],
)
def test_an_invalid_robot_is_rejected_and_nothing_is_created(
    here: Path, text: str, part: str
) -> None:
    (here / "given.xml").write_text(text)
    fault = refused("robot", "--model", "given.xml")
    assert isinstance(fault, CommandFailedError)
    assert part in fault.message
    assert not (here / "robot").exists()


def test_a_missing_file_is_rejected() -> None:
    assert (
        "`nothing.xml` cannot be read: file not found"
        in refused("robot", "--model", "nothing.xml").message
    )


def test_sensors_in_no_group_are_named(here: Path) -> None:
    (here / "whole.xml").write_text(CART)
    apart = CART.replace('<site name="imu"/>', '<site name="imu"/><site name="b"/>')
    apart = apart.replace('name="turning" site="imu"', 'name="turning" site="b"')
    (here / "apart.xml").write_text(
        apart.replace("</sensor>", '<magnetometer name="north" site="b"/></sensor>')
    )
    notes = {
        name: json.loads(obk_init(name, "--model", f"{name}.xml", "--format", "json"))["notes"]
        for name in ("whole", "apart")
    }
    unused = [n for n in notes["apart"] if n not in notes["whole"] and "model/" not in n]
    assert [
        {word for word in ("turning", "shaking", "north") if f"`{word}`" in n} for n in unused
    ] == [
        {"turning", "shaking"},
        {"north"},
    ]
    assert not any("`turning`" in note for note in notes["whole"])
