"""The environment of ROS processes."""

import pytest

from obk_cli.adapters.ros_environment import ros_environment
from obk_cli.errors import CommandFailedError


@pytest.fixture(autouse=True)
def _plain(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "RMW_IMPLEMENTATION"):
        monkeypatch.delenv(name, raising=False)


def test_a_stack_is_seen_by_this_host_only_unless_it_is_asked_for() -> None:
    assert ros_environment().variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert ros_environment("lan").variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET"


def test_what_the_user_has_set_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    environment = ros_environment()
    assert environment.variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "OFF"
    assert environment.domain == 7
    assert environment.notes == ()


def test_a_middleware_that_is_not_there_is_replaced_and_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_nowhere")
    environment = ros_environment()
    assert environment.variables["RMW_IMPLEMENTATION"] == "rmw_fastrtps_cpp"
    assert environment.notes == (
        "RMW_IMPLEMENTATION=rmw_nowhere is not installed here; rmw_fastrtps_cpp is used instead",
    )


@pytest.mark.parametrize("domain", ["x", "-1", "233"])
def test_a_domain_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch, domain: str) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    with pytest.raises(CommandFailedError, match=f"ROS_DOMAIN_ID={domain} is not a number from 0"):
        ros_environment()
