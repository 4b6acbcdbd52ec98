"""Nodes of the three generations of the Python API on the real rclpy."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast
from unittest.mock import MagicMock

import pytest
import rclpy
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import ObkJointEncoders
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from sensor_msgs.msg import Imu

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.robot import ObeliskSimRobot

from ..documents import ROOT, blocks  # noqa: TID252 - shared by folders of tests
from .generations import make_stack
from .stack import DEADLINE_S, eventually, launched, parameters, request, spinning

pytestmark = pytest.mark.ros

SENSOR = "topic:/joints,msg_type:ObkJointEncoders,history_depth:10"


def callback(message: Any = None) -> None:
    del message


class Registering(ObeliskNode):
    """Registers the given components, in its constructor or in on_configure."""

    def __init__(
        self, register: Callable[[ObeliskNode], None], *, late: bool = False, **settings: str
    ) -> None:
        super().__init__("registering", **parameters(**settings))
        self.register = register
        self.is_late = late
        if not late:
            register(self)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        if self.is_late:
            self.register(self)
        return super().on_configure(state)


def first(node: ObeliskNode) -> None:
    node.register_obk_publisher("pub_x_setting", "pub_x", ObkJointEncoders)
    node.register_obk_subscription("sub_x_setting", callback, key="sub_x")
    node.register_obk_timer("timer_x_setting", callback, "timer_x")


def second(node: ObeliskNode) -> None:
    node.register_obk_publisher("pub_x_setting", ObkJointEncoders, "pub_x")
    node.register_obk_subscription("sub_x_setting", callback, ObkJointEncoders, key="sub_x")
    node.register_obk_timer("timer_x_setting", callback, key="timer_x")


def third(node: ObeliskNode) -> None:
    node.register_obk_publisher("pub_x", ObkJointEncoders)
    node.register_obk_subscription("sub_x", callback, ObkJointEncoders)
    node.register_obk_timer("timer_x", callback)


SEPARATE = {
    "pub_x_setting": SENSOR,
    "sub_x_setting": f"{SENSOR},callback_group:fast",
    "timer_x_setting": "timer_period_sec:0.1,callback_group:None",
    "callback_group_settings": "fast:ReentrantCallbackGroup,slow:MutuallyExclusiveCallbackGroup",
}
TOGETHER = {
    "obelisk_settings": """\
callback_groups:
  fast: ReentrantCallbackGroup
  slow: MutuallyExclusiveCallbackGroup
publishers:
  - {key: pub_x, topic: /joints, msg_type: ObkJointEncoders, history_depth: 10}
subscribers:
  - {key: sub_x, topic: /joints, msg_type: ObkJointEncoders, callback_group: fast}
timers:
  - {key: timer_x, timer_period_sec: 0.1}
"""
}


@pytest.mark.parametrize("late", [False, True], ids=["constructor", "on_configure"])
@pytest.mark.parametrize(
    ("register", "settings"),
    [
        (first, SEPARATE),
        (first, TOGETHER),
        (second, SEPARATE),
        (second, TOGETHER),
        (third, TOGETHER),
    ],
)
def test_every_generation_registers_and_configures_more_than_once(
    register: Callable[[ObeliskNode], None], settings: dict[str, str], late: bool
) -> None:
    with spinning(lambda: Registering(register, late=late, **settings)) as node:
        for _ in range(2):
            assert request(node, "configure"), node.last_fault
            assert node.obk_publishers["pub_x"].msg_type is ObkJointEncoders
            assert node.obk_subscriptions["sub_x"].topic_name == "/joints"
            assert node.obk_subscriptions["sub_x"].callback_group is node.fast  # type: ignore[attr-defined]
            assert node.obk_timers["timer_x"].timer_period_ns == 100_000_000
            assert request(node, "activate"), node.last_fault
            assert request(node, "deactivate")
            assert request(node, "cleanup")


def test_a_registration_in_on_configure_is_forgotten_when_configure_fails() -> None:
    settings = {**SEPARATE, "timer_x_setting": "timer_period_sec:never"}
    with spinning(lambda: Registering(second, late=True, **settings)) as node:
        for _ in range(2):
            assert not request(node, "configure")
            assert node.last_fault is not None
            assert "`timer_period_sec` is 'never'" in node.last_fault.text


def test_registering_after_supers_on_configure_is_an_error() -> None:
    class Late(ObeliskNode):
        def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
            super().on_configure(state)
            self.register_obk_timer("late", callback)
            return TransitionCallbackReturn.SUCCESS

    with spinning(lambda: Late("late")) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert "before super().on_configure(state)" in node.last_fault.text


@pytest.mark.parametrize("register", [first, second])
def test_older_components_without_settings_fail_configure(
    register: Callable[[ObeliskNode], None],
) -> None:
    with spinning(lambda: Registering(register)) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert "set the parameter `timer_x_setting`" in node.last_fault.text


def test_newer_components_without_settings_are_left_out_with_a_warning(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with spinning(lambda: Registering(third)) as node:
        assert request(node, "configure")
        assert len(node.obk_publishers) == 0
        with pytest.raises(KeyError, match="no timer `timer_x`"):
            node.obk_timers["timer_x"]
    logged = capfd.readouterr().err
    assert logged.count("has no settings and is left out") == 3
    assert "[WARN]" in logged


def test_required_overrides_the_generation(capfd: pytest.CaptureFixture[str]) -> None:
    def register(node: ObeliskNode) -> None:
        node.register_obk_timer("timer_a", callback, required=True)
        node.register_obk_timer("timer_b_setting", callback, required=False)

    with spinning(lambda: Registering(register)) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert "timer_a" in node.last_fault.text
        assert "timer_b" not in node.last_fault.text
    assert "left out" not in capfd.readouterr().err


@pytest.mark.parametrize("register", [first, second])
def test_an_unknown_callback_group_fails_an_older_component(
    register: Callable[[ObeliskNode], None],
) -> None:
    settings = {**SEPARATE, "callback_group_settings": "slow:ReentrantCallbackGroup"}
    with spinning(lambda: Registering(register, **settings)) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert "in the callback group `fast`; available: slow" in node.last_fault.text


def test_a_newer_component_with_an_unknown_callback_group_uses_the_default_one(
    capfd: pytest.CaptureFixture[str],
) -> None:
    settings = TOGETHER["obelisk_settings"].replace("callback_group: fast", "callback_group: fats")
    with spinning(lambda: Registering(third, obelisk_settings=settings)) as node:
        assert request(node, "configure")
        assert node.obk_subscriptions["sub_x"].callback_group is node.default_callback_group
    assert "in the callback group `fats`; available: fast, slow" in capfd.readouterr().err


def test_callback_groups_are_attributes() -> None:
    class WithGroups(Registering):
        fast: Any = None
        slow: Any

        def __init__(self) -> None:
            super().__init__(first, **SEPARATE)
            self.slow = None

    with spinning(WithGroups) as node:
        assert request(node, "configure")
        assert isinstance(node.slow, MutuallyExclusiveCallbackGroup)
        before = node.slow
        assert request(node, "cleanup")
        assert request(node, "configure")
        assert node.slow is node.obk_callback_groups["slow"]
        assert node.slow is not before


def test_a_callback_group_replaces_no_other_attribute(capfd: pytest.CaptureFixture[str]) -> None:
    groups = "executor:ReentrantCallbackGroup,is_late:ReentrantCallbackGroup"
    settings = {"callback_group_settings": groups}
    with spinning(lambda: Registering(third, **settings)) as node:
        executor = node.executor
        assert request(node, "configure")
        assert node.executor is executor
        assert node.is_late is False
        assert isinstance(node.obk_callback_groups["executor"], ReentrantCallbackGroup)
    assert capfd.readouterr().err.count("is only available in obk_callback_groups") == 2


def test_a_name_that_the_launcher_sets_as_a_parameter_is_one_of_the_second_generation() -> None:
    def register(node: ObeliskNode) -> None:
        node.register_obk_publisher("joints", ObkJointEncoders)
        node.register_obk_timer("rate", callback)

    with spinning(lambda: Registering(register, joints=SENSOR, rate="")) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert "set the parameter `rate`" in node.last_fault.text
        assert "joints" not in node.last_fault.text


class TypedController(ObeliskController):
    """Its constructor takes message types, as in G2 and G3."""

    def __init__(self, **settings: str) -> None:
        super().__init__("typed", PositionSetpoint, EstimatedState, **parameters(**settings))

    def update_x_hat(self, x_hat_msg: Any) -> None:
        del x_hat_msg

    def compute_control(self) -> None:
        return None


def test_a_base_class_with_message_types_warns_of_missing_settings(
    capfd: pytest.CaptureFixture[str],
) -> None:
    settings = "timers: [{key: timer_ctrl, timer_period_sec: 0.1}]"
    with spinning(lambda: TypedController(obelisk_settings=settings)) as node:
        assert request(node, "configure")
        assert list(node.obk_timers) == ["timer_ctrl"]
    assert capfd.readouterr().err.count("left out") == 2


def test_a_base_class_with_separate_parameters_requires_all() -> None:
    settings = {"timer_ctrl_setting": "timer_period_sec:0.1"}
    with spinning(lambda: TypedController(**settings)) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert "`pub_ctrl_setting`" in node.last_fault.text


def test_existing_code_reads_the_node_name() -> None:
    with spinning(TypedController) as node:
        assert node.node_name == "typed"


def test_an_invalid_argument_names_the_node() -> None:
    with spinning(lambda: ObeliskNode("arm")) as node:
        sentence = "register_obk_timer of the node `arm`: `callback` is 3"
        with pytest.raises(ObeliskConfigError, match=sentence):
            node.register_obk_timer("timer", 3)  # type: ignore[arg-type]


def test_a_process_with_a_wrong_registration_ends_with_a_message() -> None:
    program = (
        "from obelisk_py.core.node import ObeliskNode\n"
        "from obelisk_py.core.utils.ros import spin_obelisk\n"
        "class Arm(ObeliskNode):\n"
        "    def __init__(self):\n"
        "        super().__init__('arm')\n"
        "        self.register_obk_publisher('pub', 'topic', 7)\n"
        "spin_obelisk([], Arm)\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 1
    assert "the node cannot be created: register_obk_publisher of the node `arm`: " in ended.stderr
    assert "`msg_type` is 7 (an `int`), expected a message class" in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize(
    ("robot", "estimation", "control"),
    [
        ("first", "first", "first"),
        ("second", "second", "second"),
        ("third", "third", "third"),
        ("first", "second", "third"),
        ("second", "third", "first"),
    ],
)
def test_nodes_of_every_generation_exchange_messages(
    tmp_path: Path, robot: str, estimation: str, control: str
) -> None:
    config = make_stack(tmp_path, robot=robot, estimation=estimation, control=control)
    with launched(config) as run:
        run.wait_for_line("applied 4.0")
        if robot == "first":
            run.wait_for_line("obelisk_robot_0 publishes /joints")
        run.process.send_signal(signal.SIGINT)
        assert run.process.wait(DEADLINE_S) == 0, run.text
    assert "Traceback" not in run.text


def listings(kind: str) -> list[str]:
    page = ROOT / "docs" / "how-to" / "existing-code.md"
    return [block.body for block in blocks(page) if block.kind == kind]


def page_class(name: str) -> type[Any]:
    """A class of the page, with the imports of its listing."""
    (listing,) = (text for text in listings("python") if f"class {name}(" in text)
    names = {**globals(), "Imu": Imu, "time": time, "ObeliskSimRobot": ObeliskSimRobot}
    exec(listing, names)
    return cast("type[Any]", names[name])


def test_the_pages_controller_is_configured_twice() -> None:
    methods = dict.fromkeys(("take_imu", "log", "update_x_hat", "compute_control"), callback)
    balance = type("Balance", (page_class("Balance"),), methods)
    with spinning(balance) as node:
        for _ in range(2):
            assert request(node, "configure"), node.last_fault
            assert request(node, "cleanup")


def test_the_pages_simulator_steps_and_stops() -> None:
    steps: list[list[float]] = []
    stepping = {"step": lambda _node, ctrl: steps.append(ctrl)}
    pendulum = type("Pendulum", (page_class("Pendulum"),), stepping)
    settings = {"sub_ctrl_setting": "topic:/c,msg_type:PositionSetpoint"}
    with spinning(lambda: pendulum("pendulum", **parameters(**settings))) as node:
        assert request(node, "configure")
        assert request(node, "activate")
        eventually(lambda: [0.0] in steps, "a step")
        node.obk_subscriptions["sub_ctrl"].callback(PositionSetpoint(u_mujoco=[1.0]))
        eventually(lambda: [1.0] in steps, "a step with the command")
        assert request(node, "deactivate"), node.last_fault


def test_the_pages_unit_test_passes() -> None:
    (listing,) = (text for text in listings("python") if "MagicMock" in text)

    class MyController(ObeliskController):
        def update_x_hat(self, x_hat_msg: Any) -> None:
            del x_hat_msg

        def compute_control(self) -> None:
            self.obk_publishers["pub_ctrl"].publish(PositionSetpoint())

    names: dict[str, Any] = {
        "MyController": MyController,
        "MagicMock": MagicMock,
        "Parameter": Parameter,
        "rclpy": rclpy,
    }
    exec(listing, names)
    names["test_the_control_is_published"]()


def test_the_pages_message_is_the_librarys() -> None:
    with spinning(lambda: ObeliskNode("arm")) as node:
        with pytest.raises(ObeliskConfigError) as caught:
            node.register_obk_publisher("x", msg_type=7)  # type: ignore[arg-type]
        assert f"{caught.value}\n" in listings("text")


def test_the_pages_launch_file_finds_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "stack.yaml").write_text("control: [{timers: [{key: t, timer_period_sec: 1}]}]\n")
    monkeypatch.chdir(tmp_path)
    (listing,) = (text for text in listings("python") if "launch_utils" in text)
    names: dict[str, Any] = {}
    exec(listing, names)
    assert names["parameters"]["t_setting"] == "key:t,timer_period_sec:1"
