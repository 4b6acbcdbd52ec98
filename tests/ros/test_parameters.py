"""Invalid parameters set over ROS are rejected, and the node continues."""

import math
from typing import Any

import pytest
from rcl_interfaces.msg import ParameterValue, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from .stack import eventually, request, spinning
from .test_lifecycle_node import WIRED, Controller

pytestmark = pytest.mark.ros

Message = Any


def message(name: str, value: object) -> Message:
    """A parameter as sent in a request."""
    return Parameter(name, value=value).to_parameter_msg()


def of_type(name: str, number: int) -> Message:
    """A parameter whose value claims to be of this type."""
    sent = Parameter(name, value="x").to_parameter_msg()
    sent.value = ParameterValue(type=number)
    return sent


def ask(node: Any, kind: Any, service: str, parameters: list[Message]) -> Any:
    client = node.create_client(kind, f"~/{service}")
    eventually(client.service_is_ready, f"the service {service}")
    answer = client.call_async(kind.Request(parameters=parameters))
    eventually(answer.done, f"the answer of {service}")
    node.destroy_client(client)
    return answer.result()


def set_each(node: Any, *parameters: Message) -> list[str]:
    """The reason why each parameter is rejected; empty if it is accepted."""
    results = ask(node, SetParameters, "set_parameters", list(parameters)).results
    assert all(result.successful == (not result.reason) for result in results)
    return [result.reason for result in results]


def set_together(node: Any, *parameters: Message) -> str:
    kind = SetParametersAtomically
    result = ask(node, kind, "set_parameters_atomically", list(parameters)).result
    assert result.successful == (not result.reason)
    return str(result.reason)


def assert_works(node: Any) -> None:
    """Assert that the node is active, without a fault, and ticks."""
    assert (node.state_label, node.last_fault) == ("active", None)
    before = node.ticks
    eventually(lambda: node.ticks > before + 2, "the ticks of an active node")


PERIOD = "expected a number of seconds above 0, from 1e-09 to 9e+09"
REFUSED = (
    (message("timer_ctrl_setting", 5), "expected 'Type.STRING' got 'Type.INTEGER'"),
    (message("timer_ctrl_setting", "{timer_period_sec: fast}"), f"is 'fast', {PERIOD}"),
    (message("timer_ctrl_setting", "{timer_period_sec: -1}"), f"is -1, {PERIOD}"),
    (message("timer_ctrl_setting", "{timer_period_sec: .nan}"), f"is nan, {PERIOD}"),
    (message("timer_ctrl_setting", "{a: ["), "the parameter `timer_ctrl_setting` cannot be read"),
    (message("timer_ctrl_setting", "{timer_period_sec: 0.5}"), "clean up, set it, configure again"),
    (message("pub_ctrl_setting", "{topic: 3}"), "has no `topic` in its settings"),
    (
        message("pub_ctrl_setting", "{topic: /c, msg_type: PositionSetpiont}"),
        "`PositionSetpiont` is not known; similar names: PositionSetpoint",
    ),
    (
        message("sub_est_setting", "{topic: /e, msg_type: EstimatedState, history_depth: 0}"),
        "`history_depth` is 0, expected a whole number from 1 to 2147483647",
    ),
    (message("obelisk_settings", "callback_groups: 3"), "`callback_groups` is not a mapping"),
    (message("use_sim_time", True), "`use_sim_time` is read during the `configure` transition"),
    (message("report_rates", False), "`configure` transition: clean up, set it"),
    (message("use_sim_time", "yes"), "expected 'Type.BOOL' got 'Type.STRING'"),
    (message("params_paht", "x"), "no parameter `params_paht`; did you mean `params_path`?"),
    (message("", "x"), "the node has no parameter ``; available: `callback_group_settings`"),
    (of_type("params_path", 99), "a value of the type 99; expected one of: 0 (not_set), 1 (bool)"),
    (of_type("params_path", 0), "Static parameter cannot be undeclared"),
)


def test_an_active_node_reports_invalid_values_and_continues() -> None:
    with spinning(Controller) as node:
        assert request(node, "configure")
        assert request(node, "activate")
        before = {name: parameter.value for name, parameter in node._parameters.items()}
        for reported, (_, expected) in zip(
            set_each(node, *(sent for sent, _ in REFUSED)), REFUSED, strict=True
        ):
            assert expected in reported
        for sent, expected in REFUSED:
            assert expected in set_together(node, message("params_path", "half"), sent)
        assert {name: p.value for name, p in node._parameters.items()} == before
        assert not node.get_clock().ros_time_is_active
        assert_works(node)
        # Changes without effect are accepted, and so are parameters that are read when needed.
        same = message("timer_ctrl_setting", WIRED["timer_ctrl_setting"])
        assert set_each(node, same, message("params_path", "/there")) == ["", ""]
        assert node.params_path == "/there"


def test_settings_are_checked_before_configure_and_taken() -> None:
    with spinning(Controller) as node:
        wrong = message("timer_ctrl_setting", "{timer_period_sec: 0}")
        right = message("timer_ctrl_setting", "{timer_period_sec: 0.02}")
        refused, taken = set_each(node, wrong, right)
        assert PERIOD in refused
        assert taken == ""
        assert set_each(node, message("use_sim_time", True), message("use_sim_time", False)) == [
            "",
            "",
        ]
        assert request(node, "configure")
        assert node.obk_timers["timer_ctrl"].timer_period_ns == 20_000_000


def test_a_check_by_the_user_that_raises_rejects() -> None:
    def check(parameters: list[Parameter]) -> SetParametersResult:
        if any(parameter.value > 3 for parameter in parameters if parameter.name == "gain"):
            raise ValueError("too much")
        return SetParametersResult(successful=True)

    with spinning(Controller) as node:
        node.declare_parameter("gain", 1)
        node.add_on_set_parameters_callback(check)
        assert request(node, "configure")
        assert request(node, "activate")
        reported = "the node's check of `gain` raised ValueError: too much"
        assert set_each(node, message("gain", 5), message("gain", 2)) == [reported, ""]
        assert_works(node)
        node.remove_on_set_parameters_callback(check)
        assert set_each(node, message("gain", 5)) == [""]


def test_a_check_by_the_user_without_a_result_rejects_and_is_named() -> None:
    def check(_parameters: list[Parameter]) -> None:
        """Returns nothing."""

    with spinning(Controller) as node:
        node.declare_parameter("gain", 1)
        node.add_on_set_parameters_callback(check)
        (reported,) = set_each(node, message("gain", 5))
        assert reported.startswith("the node's check of `gain`: `test_a_check_by_the_user_")
        assert reported.endswith(
            ".check` returned None, expected a `SetParametersResult` "
            "(did the callback forget its return statement?)"
        )


@pytest.mark.mujoco
def test_a_simulator_accepts_only_parameters_it_could_be_configured_with() -> None:
    from .test_mujoco_robot import simulator

    refused = {
        ("realtime_factor", "fast"): "the parameter `realtime_factor` is 'fast', expected a number",
        ("realtime_factor", -1.0): "expected a number above 0, or 0 for as fast as possible",
        ("realtime_factor", math.inf): "expected a number above 0",
        ("viewer", "hologram"): "expected one of: none, native, web",
        ("viewer_port", 99999): "expected a port from 1 to 65535, or 0 for a free one",
        ("viewer_port", "web"): "expected 'Type.INTEGER' got 'Type.STRING'",
        ("render", "film.doc"): "the video that `render` requests: ",
        ("mujoco_setting", "{a: ["): "the parameter `mujoco_setting`",
        ("mujoco_setting", ""): "the parameter `mujoco_setting` is not set",
    }
    sent = [message(name, value) for name, value in refused]
    with simulator() as (node, _):
        for state in ("unconfigured", "active"):
            for reported, expected in zip(set_each(node, *sent), refused.values(), strict=True):
                assert expected in reported, state
            if state == "unconfigured":
                assert set_each(node, of_type("realtime_factor", 0)) != [""]
                assert request(node, "configure")
                assert request(node, "activate")
        reported = set_each(node, message("viewer", "web"), message("ic_keyframe", "nowhere"))
        assert reported[0].startswith("`viewer` ")
        assert "keyframe `nowhere`" in reported[1]
        assert (node.state_label, node.last_fault) == ("active", None)
        assert node.get_parameter("realtime_factor").value == 1.0
