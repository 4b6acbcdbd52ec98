"""The guarded lifecycle on the real rclpy: reported faults, rejected requests, no leaks."""

import gc
from pathlib import Path
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from obelisk_control_msgs.msg import PositionSetpoint
from rclpy.callback_groups import CallbackGroup
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskHardwareError
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.sensing import ObeliskSensor
from obelisk_py.core.spinning import _shut_down

from .stack import eventually, parameters, request, spinning

pytestmark = pytest.mark.ros

SUCCESS = TransitionCallbackReturn.SUCCESS
WIRED = {
    "pub_ctrl_setting": "{topic: /c, msg_type: PositionSetpoint}",
    "sub_est_setting": "{topic: /e, msg_type: EstimatedState}",
    "timer_ctrl_setting": "{timer_period_sec: 0.01}",
}


class Controller(ObeliskController):
    """Counts its ticks; raises at the given one."""

    def __init__(self, raise_at: int | None = None, **settings: str) -> None:
        super().__init__("controller", **parameters(**{**WIRED, **settings}))
        self.raise_at = raise_at
        self.ticks = 0

    def update_x_hat(self, x_hat_msg: Any) -> None:
        del x_hat_msg

    def compute_control(self) -> Any:
        self.ticks += 1
        if self.ticks == self.raise_at:
            raise ValueError("no gain")
        message = PositionSetpoint(u_mujoco=[0.0])
        self.obk_publishers["pub_ctrl"].publish(message)
        return message


class Misbehaving(ObeliskNode):
    """Returns the given result from `configure`, or raises it."""

    def __init__(self, answer: Any, on_error: Any = SUCCESS) -> None:
        super().__init__("misbehaving")
        self.answer, self.error_answer = answer, on_error

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        super().on_configure(state)
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        super().on_error(state)
        return self.error_answer


def test_a_controller_runs_through_its_lifecycle() -> None:
    with spinning(Controller) as node:
        for label, state in (
            ("configure", "inactive"),
            ("activate", "active"),
            ("deactivate", "inactive"),
            ("cleanup", "unconfigured"),
            ("shutdown", "finalized"),
        ):
            assert request(node, label)
            assert node.state_label == state


def test_timers_run_only_while_active() -> None:
    with spinning(Controller) as node:
        assert isinstance(node, Controller)
        request(node, "configure")
        assert node.ticks == 0
        request(node, "activate")
        eventually(lambda: node.ticks > 3, "ticks")
        request(node, "deactivate")
        ticks = node.ticks
        request(node, "activate")
        eventually(lambda: node.ticks > ticks, "ticks after a second activate")


def test_an_exception_in_configure_is_kept_with_its_traceback_and_ends_unconfigured() -> None:
    with spinning(lambda: Misbehaving(ValueError("no such motor"))) as node:
        assert not request(node, "configure")
        assert node.state_label == "unconfigured"
        assert node.last_fault is not None
        assert node.last_fault.text.startswith("ValueError: ")
        assert "raise self.answer" in node.last_fault.traceback
        response = node._on_last_error(Trigger.Request(), Trigger.Response())
        assert response.success
        assert response.message.startswith("on_configure: ValueError: no such motor\nTraceback")


def test_a_forgotten_return_is_named() -> None:
    with spinning(lambda: Misbehaving(None)) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert node.last_fault.text == (
            "`Misbehaving.on_configure` returned None, expected a `TransitionCallbackReturn` "
            "(did the callback forget its return statement?)"
        )
        assert node.state_label == "unconfigured"


def test_an_answer_of_another_type_is_named_with_the_class_and_the_method() -> None:
    with spinning(lambda: Misbehaving(False)) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert str(node.last_fault) == (
            "on_configure: `Misbehaving.on_configure` returned False, expected a "
            "`TransitionCallbackReturn`"
        )


def test_a_failure_leaves_the_state_unchanged_and_is_reported() -> None:
    with spinning(lambda: Misbehaving(TransitionCallbackReturn.FAILURE)) as node:
        assert not request(node, "configure")
        assert node.state_label == "unconfigured"
        assert node.last_fault is not None
        assert node.last_fault.text.startswith("`Misbehaving.on_configure` returned FAILURE ")


def test_the_fault_that_a_callback_reported_before_error_is_kept() -> None:
    class Telling(ObeliskNode):
        def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
            super().on_configure(state)
            self.fail("no such motor", "the bus")
            return TransitionCallbackReturn.ERROR

    with spinning(lambda: Telling("telling")) as node:
        assert not request(node, "configure")
        assert node.state_label == "unconfigured"
        assert str(node.last_fault) == "the bus: no such motor"


def test_a_fault_of_the_hardware_is_reported_by_its_message_alone() -> None:
    with spinning(lambda: Misbehaving(ObeliskHardwareError("no such motor"))) as node:
        assert not request(node, "configure")
        assert str(node.last_fault) == "on_configure: no such motor"


class Opening(ObeliskNode):
    """Opens something in `configure`, before or after super's; records what happens to it."""

    def __init__(self, *, is_early: bool = False) -> None:
        super().__init__("opening")
        self.is_early = is_early
        self.reported: list[str] = []

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        if self.is_early:
            self.open()
        result = super().on_configure(state)
        if not self.is_early:
            self.open()
        return result

    def open(self) -> None:
        self.reported.append("opened")
        self.opened.callback(lambda: self.reported.append("closed"))


@pytest.mark.parametrize("is_early", [True, False])
@pytest.mark.parametrize(
    "way", [["cleanup"], ["shutdown"], ["activate", "shutdown"], ["activate", "deactivate"]]
)
def test_resources_of_configure_are_closed_when_the_node_is_unconfigured(
    way: list[str], is_early: bool
) -> None:
    with spinning(lambda: Opening(is_early=is_early)) as node:
        assert isinstance(node, Opening)
        for label in ("configure", *way):
            assert request(node, label)
        is_inactive = node.state_label == "inactive"
        assert node.reported == (["opened"] if is_inactive else ["opened", "closed"])
    assert node.reported == ["opened", "closed"]


def test_resources_of_configure_are_closed_at_an_error_and_opened_again() -> None:
    with spinning(Opening) as node:
        assert isinstance(node, Opening)
        for reported in (["opened", "closed"], ["opened", "closed"] * 2):
            assert request(node, "configure")
            node.fail("the bus is dead", "watchdog")
            eventually(lambda: node.state_label == "unconfigured", "error processing")
            assert node.reported == reported


@pytest.mark.parametrize("label", ["configure", "activate", "deactivate"])
def test_a_transition_that_calls_exit_fails_and_resources_are_closed(label: str) -> None:
    class Exiting(Opening):
        def _exit(self, state: LifecycleState) -> TransitionCallbackReturn:
            raise SystemExit(0)

        def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
            return self._exit(state) if label == "activate" else super().on_activate(state)

        def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
            return self._exit(state) if label == "deactivate" else super().on_deactivate(state)

        def open(self) -> None:
            super().open()
            if label == "configure":
                raise SystemExit(0)

    with spinning(Exiting) as node:
        assert isinstance(node, Exiting)
        for step in ("configure", "activate", "deactivate"):
            assert request(node, step) == (step != label)
            if step == label:
                break
        assert node.state_label == "unconfigured"
        assert node.reported == ["opened", "closed"]
        assert "SystemExit" in str(node.last_fault)


def test_a_shutdown_that_fails_is_not_repeated() -> None:
    class Failing(ObeliskNode):
        attempts = 0

        def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
            self.attempts += 1
            raise OSError("the bus is gone")

    with spinning(lambda: Failing("failing")) as node:
        assert isinstance(node, Failing)
        _shut_down(node)
        assert node.attempts == 1
        assert node.ended.done()


def test_a_node_whose_error_processing_fails_is_finalized_and_ended() -> None:
    answer = TransitionCallbackReturn.FAILURE
    with spinning(lambda: Misbehaving(ValueError("x"), on_error=answer)) as node:
        assert not request(node, "configure")
        assert node.state_label == "finalized"
        assert node.ended.done()


@pytest.mark.parametrize(
    "number", [Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DESTROY, 99]
)
def test_an_invalid_transition_is_rejected_and_the_node_continues(number: int) -> None:
    with spinning(Controller) as node:
        assert not request(node, number=number)
        assert node.state_label == "unconfigured"
        assert request(node, number=Transition.TRANSITION_CONFIGURE)


def test_an_exception_in_a_timer_takes_the_node_to_error_processing() -> None:
    with spinning(lambda: Controller(raise_at=3)) as node:
        request(node, "configure")
        request(node, "activate")
        eventually(lambda: node.state_label == "unconfigured", "error processing")
        assert node.last_fault is not None
        assert node.last_fault.where == "Controller.compute_control"
        assert node.last_fault.text == "ValueError: no gain"
        assert not node.obk_timers
        assert request(node, "configure")
        assert node.last_fault is None


def test_fail_may_be_called_from_any_thread() -> None:
    with spinning(Controller) as node:
        request(node, "configure")
        request(node, "activate")
        node.fail("the bus is dead", "watchdog")
        eventually(lambda: node.state_label == "unconfigured", "error processing")
        assert str(node.last_fault) == "watchdog: the bus is dead"


def test_a_fault_while_nothing_runs_is_reported_and_fails_no_later_transition() -> None:
    answers = []

    def fail_and_shut_down(node: Controller) -> None:
        node.fail("late", "a callback of its own")
        answers.append(node.trigger_shutdown())

    with spinning(Controller) as node:
        assert node.executor is not None
        node.executor.create_task(fail_and_shut_down, node)
        eventually(lambda: answers, "the end")
        assert (node.state_label, answers) == ("finalized", [SUCCESS])
        assert str(node.last_fault) == "a callback of its own: late"


def test_a_requested_transition_does_not_fail_for_an_earlier_fault() -> None:
    answers = []

    def fail_and_request(node: Controller) -> None:
        node.fail("no gain", "a callback of its own")
        call = ChangeState.Request(transition=Transition(label="shutdown"))
        change = node._service_change_state.callback
        answers.append(change(call, ChangeState.Response()).success)

    with spinning(Controller) as node:
        request(node, "configure")
        assert node.executor is not None
        node.executor.create_task(fail_and_request, node)
        eventually(lambda: answers, "the answer")
        assert (node.state_label, answers) == ("finalized", [True])
        assert str(node.last_fault) == "a callback of its own: no gain"


def test_missing_settings_are_named_together() -> None:
    with spinning(lambda: Controller(pub_ctrl_setting="", timer_ctrl_setting="")) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert "`pub_ctrl_setting`" in node.last_fault.text
        assert "`timer_ctrl_setting`" in node.last_fault.text


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("{topic: /c}", "has no message type"),
        ("{topic: /c, msg_type: PositionSetpont}", "`PositionSetpont` is not known; similar names"),
        ("{topic: /c, msg_type: nope_msgs/msg/A}", "the package `nope_msgs` is not installed"),
        ("{topic: /c, msg_type: PositionSetpoint, callback_group: g}", "callback group `g`"),
        ("{topic: [", "the parameter `pub_ctrl_setting` cannot be read"),
    ],
)
def test_invalid_settings_fail_configure_with_a_message(setting: str, sentence: str) -> None:
    with spinning(lambda: Controller(pub_ctrl_setting=setting)) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert sentence in node.last_fault.text


def test_settings_come_only_from_obelisk_settings() -> None:
    settings = """
callback_groups: {fast: ReentrantCallbackGroup}
publishers: [{key: pub_ctrl, topic: /c, msg_type: PositionSetpoint, callback_group: fast}]
subscribers: [{key: sub_est, topic: /e, msg_type: EstimatedState}]
timers: [{key: timer_ctrl, timer_period_sec: 0.01}]
"""
    empty = dict.fromkeys(WIRED, "")
    with spinning(lambda: Controller(obelisk_settings=settings, **empty)) as node:
        assert request(node, "configure")
        assert isinstance(node, Controller)
        assert node.obk_publishers["publisher_ctrl"].topic == "/c"
        assert list(node.obk_callback_groups) == ["fast"]


def test_configure_takes_new_parameters_after_cleanup() -> None:
    with spinning(Controller) as node:
        assert isinstance(node, Controller)
        request(node, "configure")
        request(node, "cleanup")
        new = "{topic: /other, msg_type: PositionSetpoint}"
        node.set_parameters([Parameter("pub_ctrl_setting", value=new)])
        request(node, "configure")
        assert node.obk_publishers["pub_ctrl"].topic == "/other"


def test_code_and_config_may_not_name_different_types() -> None:
    wrong = {**WIRED, "pub_ctrl_setting": "{topic: /c, msg_type: VelocityCommand}"}

    class Typed(Controller):
        def __init__(self) -> None:
            ObeliskController.__init__(self, "typed", PositionSetpoint, **parameters(**wrong))

    with spinning(lambda: Typed()) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert (
            "is an `obelisk_control_msgs/msg/PositionSetpoint` in the code "
            "and a `VelocityCommand` in the config"
        ) in node.last_fault.text


def test_publishing_while_inactive_is_dropped() -> None:
    with spinning(Controller) as node:
        assert isinstance(node, Controller)
        request(node, "configure")
        node.compute_control()
        assert node.last_fault is None


class TooEarly(ObeliskNode):
    """Registers a component before the base class is initialized."""

    def __init__(self) -> None:
        self.register_obk_timer("timer_a", print)
        super().__init__("too_early")


def test_registering_before_the_base_class_is_an_error() -> None:
    with pytest.raises(ObeliskConfigError, match=r"called before super\(\).__init__"):
        TooEarly()


class WithoutArgument(Controller):
    """Its callback takes no message."""

    def __init__(self) -> None:
        super().__init__()
        self.register_obk_subscription("sub_a", self.on_a, PositionSetpoint, default="topic:/a")

    def on_a(self) -> None:
        """Not called."""


def test_a_callback_without_an_argument_is_reported_with_its_subscription() -> None:
    with spinning(WithoutArgument) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert "the subscription `sub_a`" in node.last_fault.text
        assert "callback" in node.last_fault.text


def test_registering_twice_or_late_is_an_error() -> None:
    with spinning(Controller) as node:
        assert isinstance(node, Controller)
        with pytest.raises(ObeliskConfigError, match="is already registered"):
            node.register_obk_publisher("pub_ctrl_setting")
        with pytest.raises(ObeliskConfigError, match="is already registered"):
            node.register_obk_publisher(key="publisher_ctrl")
        request(node, "configure")
        with pytest.raises(ObeliskConfigError, match="after the `configure` transition"):
            node.register_obk_publisher(key="late")


def test_a_service_that_forgets_its_answer_is_a_fault_and_its_client_gets_one() -> None:
    def forget(request: Any, response: Any) -> Any:
        del request, response

    with spinning(Controller) as node:
        service = node.create_service(Trigger, "~/forget", forget)
        request(node, "configure")
        request(node, "activate")
        response = Trigger.Response()
        assert service.callback(Trigger.Request(), response) is response
        eventually(lambda: node.state_label == "unconfigured", "error processing")
        assert node.last_fault is not None
        reported = (
            "returned None, expected a `Trigger_Response` (did the callback forget its return"
        )
        assert reported in node.last_fault.text


def test_a_sensor_without_a_publisher_is_reported_with_the_missing_setting() -> None:
    with spinning(lambda: ObeliskSensor("sensor")) as node:
        assert not request(node, "configure")
        assert node.last_fault is not None
        assert "registers no publisher" in node.last_fault.text


@pytest.mark.slow
def test_a_thousand_rounds_leak_nothing() -> None:
    with spinning(Controller) as node:
        open_files = Path("/proc/self/fd")

        def entities_of_groups() -> int:
            groups = (it for it in gc.get_objects() if isinstance(it, CallbackGroup))
            return sum(len(group.entities) for group in groups)

        def go_round(times: int) -> tuple[int, int]:
            for _ in range(times):
                for label in ("configure", "activate", "deactivate", "cleanup"):
                    assert request(node, label)
            return len(list(open_files.iterdir())), entities_of_groups()

        files, entities = go_round(5)
        files_later, entities_later = go_round(1000)
        # A leak would occur a thousand times; a few objects are still being deleted.
        assert files_later < files + 20
        assert entities_later < entities + 20
        assert not list(node.timers)
