"""Names that exist for existing code."""

import subprocess
import sys
from pathlib import Path
from typing import Any, TypeVar

import obelisk_control_msgs.msg
import pytest
from ament_index_python import packages
from obelisk_control_msgs.msg import PDFeedForward, PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from rcl_interfaces.msg import ParameterEvent
from sensor_msgs.msg import Imu

from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskMsgError
from obelisk_py.core.obelisk_typing import (
    ObeliskAllowedMsg,
    ObeliskControlMsg,
    ObeliskMsg,
    is_in_bound,
)
from obelisk_py.core.utils.internal import check_and_get_obelisk_msg_type, get_classes_in_module
from obelisk_py.core.utils.launch_utils import get_parameters_dict, load_config_file
from obelisk_spec.components import parse_component_setting, parse_mapping
from obelisk_spec.runtime_protocol import USE_SIM_TIME
from obk_cli.compiler import Options, compile_config

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


def test_a_message_error_has_its_message() -> None:
    assert ObeliskMsgError("no such type").msg == "no such type"


def test_a_config_error_is_a_value_error() -> None:
    assert issubclass(ObeliskConfigError, ValueError)


def test_allowed_messages_are_those_of_obelisk_and_of_ros_nodes() -> None:
    assert is_in_bound(PositionSetpoint, ObeliskAllowedMsg)
    assert is_in_bound(ParameterEvent, ObeliskAllowedMsg)
    assert not is_in_bound(ParameterEvent, ObeliskMsg)
    assert not is_in_bound(Imu, ObeliskAllowedMsg)


def test_a_type_variable_without_a_bound_is_a_value_error() -> None:
    with pytest.raises(ValueError, match="has no bound"):
        is_in_bound(PositionSetpoint, TypeVar("Unbound"))


def test_the_classes_of_a_message_module_are_its_messages() -> None:
    classes = get_classes_in_module(obelisk_control_msgs.msg)
    assert {PositionSetpoint, PDFeedForward} <= set(classes)
    assert EstimatedState not in classes
    assert Path not in get_classes_in_module(sys.modules[__name__])


@pytest.mark.parametrize(
    "allowed",
    [None, obelisk_control_msgs.msg, ObeliskControlMsg, PositionSetpoint, [PositionSetpoint]],
)
@pytest.mark.parametrize("name", ["PositionSetpoint", "obelisk_control_msgs/msg/PositionSetpoint"])
def test_a_message_type_is_found_by_name(name: str, allowed: Any) -> None:
    assert check_and_get_obelisk_msg_type(name, allowed) is PositionSetpoint


@pytest.mark.parametrize(
    ("name", "allowed", "words"),
    [
        ("EstimatedState", ObeliskControlMsg, "`EstimatedState` is not allowed here"),
        ("PositionSetpont", obelisk_control_msgs.msg, "did you mean `PositionSetpoint`"),
        ("Nope", None, "`Nope` is not known"),
    ],
)
def test_another_name_is_a_message_error(name: str, allowed: Any, words: str) -> None:
    with pytest.raises(ObeliskMsgError, match=words):
        check_and_get_obelisk_msg_type(name, allowed)


def test_launch_utils_need_no_launch() -> None:
    program = (
        "import sys; sys.modules['launch'] = sys.modules['launch_ros'] = None\n"
        "import obelisk_py.core.utils.launch_utils\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_config_is_found_in_the_share_folder_of_a_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    share = tmp_path / "share" / "arm_ros"
    (share / "config").mkdir(parents=True)
    (share / "config" / "arm.yaml").write_text("config: arm\nviz: {on: true}\n")
    index = tmp_path / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "arm_ros").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    config = {"config": "arm", "viz": {"on": True}}
    assert load_config_file("arm.yaml", "arm_ros") == config
    assert load_config_file(share / "config" / "arm.yaml") == config
    with pytest.raises(FileNotFoundError, match=r"`; searched: .*arm_ros/config/leg\.yaml"):
        load_config_file("leg.yaml", "arm_ros")
    with pytest.raises(FileNotFoundError, match=r"`; searched: .*/leg\.yaml$"):
        load_config_file("leg.yaml", "not a name")
    assert packages.get_package_prefix("arm_ros") == str(tmp_path)


@pytest.mark.parametrize("text", ["- a\n", "a: [\n"])
def test_an_invalid_config_file_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "arm.yaml").write_text(text)
    with pytest.raises(ObeliskConfigError, match=r"arm\.yaml"):
        load_config_file(tmp_path / "arm.yaml")


def test_the_parameters_of_a_node_are_those_that_the_compiler_writes() -> None:
    path = EXAMPLES / "dummy" / "dummy.yaml"
    options = Options(variables={}, working_folder=EXAMPLES, ignore=("OBK4", "OBK300"))
    plan = compile_config(str(path), options).plan
    assert plan is not None
    config = load_config_file(path)
    for process in plan.nodes:
        node = config["onboard"][process.section]
        found = get_parameters_dict(node[0] if isinstance(node, list) else node)
        # The time source of a node is decided for the whole stack.
        assert found.keys() == process.parameters.keys() - {USE_SIM_TIME}
        same = [name for name in found if name not in ("params_path", "mujoco_setting")]
        assert {name: found[name] for name in same} == {n: process.parameters[n] for n in same}


def test_parameters_contain_groups_and_custom_parameters() -> None:
    node = {
        "callback_groups": {"fast": "ReentrantCallbackGroup"},
        "timers": {"key": "tick", "timer_period_sec": 0.1, "callback_group": "fast"},
        "params": {"gains": {"p": [1.0, 2.0]}, "name": "arm"},
    }
    parameters = get_parameters_dict(node)
    assert parameters["gains.p"] == [1.0, 2.0]
    assert parameters["name"] == "arm"
    assert parameters["callback_group_settings"] == "fast:ReentrantCallbackGroup"
    assert parse_component_setting(parameters["tick_setting"])["callback_group"] == "fast"
    assert set(parse_mapping(parameters["obelisk_settings"])) == {"timers", "callback_groups"}


def test_a_component_without_a_name_is_an_error() -> None:
    with pytest.raises(ObeliskConfigError, match="neither `ros_parameter` nor `key`"):
        get_parameters_dict({"timers": [{"timer_period_sec": 0.1}]})
