from pathlib import Path

import pytest

from obk_cli.compiler import Options, Outcome, compile_config

ACCEPTED = Path(__file__).parents[3] / "cases" / "accept" / "OBK115" / "unknown_message.yaml"
MANIFEST = "<package format='3'><name>{}</name><version>0.1.0</version></package>"


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    for package, messages in {"arm_msgs": ("Reach", "Grip"), "demo": ()}.items():
        folder = tmp_path / "src" / package
        folder.mkdir(parents=True)
        (folder / "package.xml").write_text(MANIFEST.format(package))
        for name in messages:
            (folder / "msg").mkdir(exist_ok=True)
            (folder / "msg" / f"{name}.msg").write_text("float64 a\n")
    return tmp_path


def compile_with(workspace: Path, controller: str, robot: str | None = None) -> Outcome:
    head, robots = ACCEPTED.read_text().split("robot:\n")
    head = head.replace("msg_type: PositionSetpoint", f"msg_type: {controller}")
    robots = robots.replace("msg_type: PositionSetpoint", f"msg_type: {robot or controller}")
    (workspace / "config.yaml").write_text(f"{head}robot:\n{robots}")
    ignore = tuple(f"OBK40{number}" for number in range(1, 10))
    options = Options(variables={}, working_folder=workspace, ignore=ignore)
    return compile_config(str(workspace / "config.yaml"), options)


def reported(outcome: Outcome) -> list[tuple[str, str, str | None]]:
    return list(dict.fromkeys((d.code, d.message, d.help) for d in outcome.diagnostics))


def test_a_message_of_the_workspace_is_known_before_it_is_built(workspace: Path) -> None:
    outcome = compile_with(workspace, "arm_msgs/Reach")
    assert reported(outcome) == []
    assert outcome.plan is not None
    ends = [end for process in outcome.plan.nodes for end in process.publishes]
    assert "arm_msgs/msg/Reach" in [end.msg_type for end in ends]


def test_a_message_that_its_package_lacks_is_reported_with_those_that_it_has(
    workspace: Path,
) -> None:
    (code, message, help) = reported(compile_with(workspace, "arm_msgs/msg/Raech"))[0]
    assert (code, message) == ("OBK115", "package `arm_msgs` has no message `Raech`")
    assert help == "did you mean `arm_msgs/msg/Reach`?"
    assert reported(compile_with(workspace, "arm_msgs/Xyz"))[0][2] == "available: `Grip`, `Reach`"
    assert reported(compile_with(workspace, "demo/Xyz"))[0][2] == "it does not define any messages"


def test_a_bare_name_of_the_workspace_is_reported_with_its_package(workspace: Path) -> None:
    outcome = compile_with(workspace, "Reach", "PositionSetpoint")
    assert reported(outcome)[0] == (
        "OBK115",
        "message type `Reach` is not known",
        "did you mean `arm_msgs/Reach`?",
    )
    assert [edit.text for edit in outcome.diagnostics[0].fix] == ["arm_msgs/Reach"]


def test_a_package_that_is_nowhere_is_reported_with_near_ones(workspace: Path) -> None:
    assert reported(compile_with(workspace, "amr_msgs/Reach"))[0] == (
        "OBK411",
        "message type `amr_msgs/Reach`: package `amr_msgs` was not found",
        "did you mean `arm_msgs`?",
    )


def test_the_usual_packages_of_ros_are_optional(workspace: Path) -> None:
    assert reported(compile_with(workspace, "nav_msgs/Goals")) == []


def test_two_types_of_the_workspace_on_one_topic_differ(workspace: Path) -> None:
    assert reported(compile_with(workspace, "arm_msgs/Reach", "arm_msgs/Grip"))[0][:2] == (
        "OBK205",
        "`/obelisk_robot_0` subscribes to `/arm/ctrl` as `arm_msgs/Grip`, but `/obelisk_control_0` "
        "publishes it as `arm_msgs/Reach`",
    )


SETUP = "setup(entry_points={'console_scripts': ['controller = demo.nodes:main']})"
CODE = """
from arm_msgs.msg import Raech
from obelisk_py.core.control import ObeliskController
from obelisk_py.core.utils.ros import spin_obelisk


class Controller(ObeliskController):
    def __init__(self, node_name="controller"):
        super().__init__(node_name, ctrl_msg_type=Raech)

    def update_x_hat(self, x_hat_msg): ...

    def compute_control(self): ...


def main():
    spin_obelisk(None, Controller)
"""


def with_code(workspace: Path, code: str) -> None:
    demo = workspace / "src" / "demo"
    (demo / "demo").mkdir()
    (demo / "setup.py").write_text(SETUP)
    (demo / "demo" / "nodes.py").write_text(code)


@pytest.mark.parametrize(
    ("imported", "fault"),
    [
        (
            "obelisk_control_msgs.msg import PositionSetpiont as Raech",
            (
                "OBK410",
                "`controller` cannot start: package `obelisk_control_msgs` has no message "
                "`PositionSetpiont`",
                "did you mean `PositionSetpoint`?",
            ),
        ),
        (
            "amr_msgs.msg import Raech",
            (
                "OBK411",
                "`controller` cannot start: message package `amr_msgs` was not found",
                "did you mean `arm_msgs`?",
            ),
        ),
        ("nav_msgs.msg import Goals as Raech", None),
    ],
)
def test_an_undefined_message_class_is_reported(
    workspace: Path, imported: str, fault: tuple[str, str, str] | None
) -> None:
    with_code(workspace, CODE.replace("arm_msgs.msg import Raech", imported))
    found = reported(compile_with(workspace, "PositionSetpoint"))
    assert [one for one in found if one[0] in ("OBK410", "OBK411")] == ([fault] if fault else [])


def test_a_package_that_the_config_names_too_is_reported_once(workspace: Path) -> None:
    with_code(workspace, CODE.replace("arm_msgs", "amr_msgs"))
    lost = reported(compile_with(workspace, "amr_msgs/Raech"))
    assert [one[:2] for one in lost if one[0] == "OBK411"] == [
        ("OBK411", "message type `amr_msgs/Raech`: package `amr_msgs` was not found")
    ]


def test_a_message_named_only_in_code_is_checked_too(workspace: Path) -> None:
    with_code(workspace, CODE)
    findings = compile_with(workspace, "PositionSetpoint").diagnostics
    (lost,) = (d for d in findings if d.code == "OBK410")
    assert lost.message == "`controller` cannot start: package `arm_msgs` has no message `Raech`"
    assert lost.help == "did you mean `Reach`?"
    assert lost.related[0].span.path == "src/demo/demo/nodes.py"
    assert lost.related[0].span.line == 7


@pytest.mark.parametrize("prefix", ["", "obelisk_control_msgs/", "obelisk_control_msgs/msg/"])
def test_a_package_with_a_name_of_obelisk_may_have_its_own_messages(
    workspace: Path, prefix: str
) -> None:
    folder = workspace / "src" / "obelisk_control_msgs"
    (folder / "msg").mkdir(parents=True)
    (folder / "package.xml").write_text(MANIFEST.format("obelisk_control_msgs"))
    (folder / "msg" / "Hover.msg").write_text("float64 a\n")
    outcome = compile_with(workspace, f"{prefix}Hover")
    assert {(d.code, d.severity) for d in outcome.diagnostics} == {("OBK413", "info")}
