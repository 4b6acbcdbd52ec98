"""Unit tests that projects wrote for their nodes: without an executor, by direct calls."""

import multiprocessing
import time
from collections.abc import Callable, Iterator
from typing import Any
from unittest.mock import MagicMock, patch

import pytest
import rclpy
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskMsgError
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.robot import ObeliskSimRobot

from .stack import eventually

pytestmark = pytest.mark.ros

SUCCESS = TransitionCallbackReturn.SUCCESS
TOPIC = "history_depth:10,callback_group:None,non_obelisk:False"
SETTINGS = {
    "callback_group_settings": "fast:ReentrantCallbackGroup,slow:MutuallyExclusiveCallbackGroup",
    "pub_ctrl_setting": f"key:pub_ctrl,topic:/ctrl,msg_type:PositionSetpoint,{TOPIC}",
    "sub_est_setting": "key:sub_est,topic:/est,msg_type:EstimatedState,callback_group:fast",
    "timer_ctrl_setting": "key:timer_ctrl,timer_period_sec:0.1,callback_group:slow",
}


class Controller(ObeliskController):
    def update_x_hat(self, x_hat_msg: Any) -> None:
        del x_hat_msg

    def compute_control(self) -> PositionSetpoint:
        msg = PositionSetpoint()
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg


def first() -> Controller:
    return Controller("controller")


def second() -> Controller:
    return Controller("controller", PositionSetpoint, EstimatedState)


@pytest.fixture(autouse=True)
def _context() -> Iterator[None]:
    rclpy.init()
    yield
    rclpy.shutdown()


@pytest.fixture(params=[first, second])
def node(request: pytest.FixtureRequest) -> Iterator[Controller]:
    made: Controller = request.param()
    yield made
    made.destroy_node()


def give(node: ObeliskNode, **settings: str) -> None:
    for name, value in settings.items():
        node.set_parameters([Parameter(name, Parameter.Type.STRING, value)])


def new(kind: type[Any]) -> Any:
    """An instance of a class whose constructor takes a node name."""
    return kind("node")


@pytest.mark.parametrize("state", [None, LifecycleState(state_id=1, label="unconfigured")])
def test_callbacks_are_called_directly(node: Any, state: Any) -> None:
    give(node, **SETTINGS)
    for _ in range(2):
        assert node.on_configure(state) == SUCCESS
        assert isinstance(node.fast, ReentrantCallbackGroup)
        assert isinstance(node.slow, MutuallyExclusiveCallbackGroup)
        assert node.obk_timers["timer_ctrl"].is_canceled()
        assert node.on_activate(state) == SUCCESS
        assert not node.obk_timers["timer_ctrl"].is_canceled()
        node.compute_control()
        assert node.on_deactivate(state) == SUCCESS
        assert node.on_cleanup(state) == SUCCESS
        assert not node.obk_timers
        assert not hasattr(node, "fast")


def test_cleanup_restores_an_attribute_of_a_callback_group(node: Any) -> None:
    node.fast = None
    give(node, **SETTINGS)
    node.on_configure(None)
    assert node.fast is not None
    node.on_cleanup(None)
    assert node.fast is None


def test_a_second_configure_replaces_the_entities_of_the_first(node: Any) -> None:
    give(node, **SETTINGS)
    node.on_configure(None)
    before = node.obk_timers["timer_ctrl"]
    node.on_configure(None)
    assert node.obk_timers["timer_ctrl"] is not before
    assert before not in node.timers


@pytest.mark.parametrize(
    ("parameter", "value", "error"),
    [
        ("pub_ctrl_setting", "msg_type:PositionSetpoint", ObeliskConfigError),
        ("pub_ctrl_setting", "topic:/ctrl,msg_type:Nope", ObeliskMsgError),
        ("pub_ctrl_setting", "nonsense", ObeliskConfigError),
        ("timer_ctrl_setting", "timer_period_sec:-1", ValueError),
        ("timer_ctrl_setting", "timer_period_sec:1,callback_group:nope", ValueError),
        ("callback_group_settings", "fast:Nope", ValueError),
    ],
)
def test_configure_raises_for_an_invalid_setting_and_works_once_corrected(
    node: Any, parameter: str, value: str, error: type[Exception]
) -> None:
    give(node, **{**SETTINGS, parameter: value})
    with pytest.raises(error):
        node.on_configure(None)
    give(node, **SETTINGS)
    assert node.on_configure(None) == SUCCESS


def test_components_of_on_configure_are_registered_at_each_direct_call() -> None:
    class Late(ObeliskNode):
        def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
            self.register_obk_timer("timer_late_setting", self.get_name, "timer_late")
            return super().on_configure(state)

    node = Late("late")
    with pytest.raises(ObeliskConfigError, match="has no settings"):
        node.on_configure(None)
    give(node, timer_late_setting="timer_period_sec:1")
    for _ in range(2):
        assert node.on_configure(None) == SUCCESS
        with pytest.raises(ObeliskConfigError, match="registered after the `configure` transition"):
            node.register_obk_timer("timer_late_setting", node.get_name, "timer_late")
        assert node.on_cleanup(None) == SUCCESS
    node.destroy_node()


def test_a_mock_can_replace_a_publisher(node: Any) -> None:
    node.obk_publishers["pub_ctrl"] = MagicMock()
    node.compute_control()
    node.obk_publishers["pub_ctrl"].publish.assert_called_once()


def test_a_mock_is_patched_in_for_a_while(node: Any) -> None:
    give(node, **SETTINGS)
    node.on_configure(None)
    own = node.obk_publishers["pub_ctrl"]
    with patch.dict(node.obk_publishers, {"pub_ctrl": MagicMock()}):
        node.compute_control()
        node.obk_publishers["publisher_ctrl"].publish.assert_called_once()
    assert node.obk_publishers["publisher_ctrl"] is own


def test_tables_are_dictionaries(node: Any) -> None:
    assert node.obk_publishers == {}
    assert node.obk_publishers.get("pub_ctrl") is None
    give(node, **SETTINGS)
    node.on_configure(None)
    assert isinstance(node.obk_publishers, dict)
    assert set(node.obk_publishers.keys()) == {"pub_ctrl"}
    assert "publisher_ctrl" in node.obk_publishers
    assert node.obk_publishers.get("pub_ctrl_setting") is node.obk_publishers["pub_ctrl"]


def test_the_methods_that_create_are_patched(node: Any) -> None:
    give(node, **SETTINGS)
    with (
        patch.object(node, "create_lifecycle_publisher") as publisher,
        patch.object(node, "create_subscription") as subscription,
        patch.object(node, "create_timer") as timer,
    ):
        node.on_configure(None)
    assert publisher.called
    assert subscription.called
    assert timer.called


class Simulator(ObeliskSimRobot):
    steps = 0

    def apply_control(self, control_msg: Any) -> None:
        self._set_shared_ctrl(control_msg.u_mujoco)

    def step(self) -> None:
        self.steps += 1
        time.sleep(0.001)


class WhileOk(Simulator):
    def run_simulator(self) -> None:
        while rclpy.ok():
            self.step()


class WithProcessArray(Simulator):
    def __init__(self, node_name: str) -> None:
        super().__init__(node_name, PositionSetpoint)
        self.n_u = 2
        self.lock = multiprocessing.Lock()
        self.shared_ctrl = multiprocessing.Array("d", self.n_u)

    def run_simulator(self) -> None:
        while True:
            with self.lock:
                list(self.shared_ctrl[:])
            self.step()


@pytest.mark.parametrize("simulator", [WhileOk, WithProcessArray])
def test_a_simulators_loop_ends_with_the_node(simulator: Callable[[str], Any]) -> None:
    node = simulator("simulator")
    give(node, sub_ctrl_setting="topic:/ctrl,msg_type:PositionSetpoint")
    for _ in range(2):
        node.on_configure(None)
        node.on_activate(None)
        before = node.steps
        eventually(lambda before=before: node.steps > before, "a step")
        node.apply_control(PositionSetpoint(u_mujoco=[1.0, 2.0]))
        assert list(node.shared_ctrl) == [1.0, 2.0]
        assert node.on_deactivate(None) == SUCCESS
        assert node.on_cleanup(None) == SUCCESS
    assert node.last_fault is None
    node.destroy_node()


def test_a_simulator_that_raises_without_an_executor_has_its_own_fault() -> None:
    class Broken(Simulator):
        def run_simulator(self) -> None:
            raise OSError("no model")

    node = new(Broken)
    give(node, sub_ctrl_setting="topic:/ctrl,msg_type:PositionSetpoint")
    node.trigger_configure()
    node.trigger_activate()
    eventually(lambda: node.state_label == "unconfigured", "error processing")
    assert node.last_fault.text == "OSError: no model"
    assert not node.ended.done()
    node.destroy_node()


class WithNamesOfItsOwn(Simulator):
    """Attributes with names that projects often use."""

    def __init__(self, node_name: str) -> None:
        super().__init__(node_name, PositionSetpoint)
        for name in ("start", "stop", "lock", "timer", "publisher", "subscription", "group"):
            setattr(self, f"_{name}", None)
        for name in ("age", "text", "components", "build", "hold", "release", "keep"):
            setattr(self, f"_{name}", 0.5)

    def run_simulator(self) -> None:
        while True:
            with self.lock:
                self.step()


def test_attributes_of_a_node_do_not_hide_those_of_the_library() -> None:
    node = new(WithNamesOfItsOwn)
    settings = {
        "sub_ctrl_setting": "topic:/ctrl,callback_group:fast",
        "callback_group_settings": "fast:ReentrantCallbackGroup",
        "pub_true_sim_state_setting": "topic:/true",
        "timer_true_sim_state_setting": "timer_period_sec:60",
    }
    give(node, **settings)
    for transition in ("configure", "activate", "deactivate", "cleanup", "shutdown"):
        assert getattr(node, f"trigger_{transition}")() == SUCCESS, node.last_fault
    assert node._lock is None
    node.destroy_node()
