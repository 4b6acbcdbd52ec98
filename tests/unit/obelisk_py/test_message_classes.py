"""Message classes by name, their older field names, and the type variables over them."""

import pytest
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from sensor_msgs.msg import Imu

import obelisk_py  # noqa: F401  (adds the older field names)
from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.messages import (
    add_field_aliases,
    message_class,
    message_name,
    optional_message,
    require_message,
)
from obelisk_py.core.obelisk_typing import (
    ObeliskControlMsg,
    ObeliskEstimatorMsg,
    ObeliskMsg,
    is_in_bound,
)


def test_older_field_names_are_the_same_data() -> None:
    setpoint, state = PositionSetpoint(), EstimatedState()
    setpoint.u = [1.0, 2.0]
    state.x_hat = [3.0]
    assert list(setpoint.u_mujoco) == [1.0, 2.0]
    assert list(state.q_joints) == [3.0]
    assert list(state.x_hat) == [3.0]


def test_the_wire_does_not_know_the_older_names() -> None:
    assert "u" not in PositionSetpoint.get_fields_and_field_types()


@pytest.mark.parametrize("name", ["Imu", "sensor_msgs/Imu", "sensor_msgs/msg/Imu"])
def test_a_class_is_found_by_every_form_of_its_name(name: str) -> None:
    assert message_class(name) is Imu


def test_a_class_reports_its_full_name() -> None:
    assert message_name(PositionSetpoint) == "obelisk_control_msgs/msg/PositionSetpoint"


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("PositionSetpont", r"`PositionSetpont` is not known; similar names: PositionSetpoint"),
        ("nope_msgs/msg/Nope", r"the package `nope_msgs` is not installed"),
        ("sensor_msgs/msg/Nope", r"`sensor_msgs` has no message `Nope`"),
    ],
)
def test_an_unknown_message_name_is_reported_separately(name: str, sentence: str) -> None:
    with pytest.raises(ObeliskMsgError, match=sentence):
        message_class(name)


def test_bounds_know_their_messages() -> None:
    assert is_in_bound(PositionSetpoint, ObeliskControlMsg)
    assert is_in_bound(EstimatedState, ObeliskEstimatorMsg)
    assert is_in_bound(EstimatedState, ObeliskMsg)
    assert not is_in_bound(EstimatedState, ObeliskControlMsg)
    assert not is_in_bound(Imu, ObeliskMsg)


def test_a_package_of_another_release_may_lack_messages_and_have_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr("obelisk_sensor_msgs.msg.ObkImu")
    monkeypatch.setattr("obelisk_sensor_msgs.msg.ObkSonar", Imu, raising=False)
    for name in ("ObkSonar", "obelisk_sensor_msgs/ObkSonar", "obelisk_sensor_msgs/msg/ObkSonar"):
        assert message_class(name) is Imu
    missing = optional_message("ObkImu")
    for use in (missing, lambda: require_message(missing), lambda: message_class("ObkImu")):
        with pytest.raises(ObeliskMsgError, match=r"`ObkImu`.*obelisk_sensor_msgs"):
            use()
    assert require_message(optional_message("ObkScan")).__name__ == "ObkScan"
    assert message_name(missing) == "obelisk_sensor_msgs/msg/ObkImu"
    assert not isinstance(Imu(), missing)


def test_field_names_of_the_other_layout_are_added_to_either(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class PositionSetpoint:
        """The class as in 2024; fields are properties, as in all generated classes."""

        def __init__(self) -> None:
            self._u: list[float] = []

        @property
        def u(self) -> list[float]:
            return self._u

        @u.setter
        def u(self, value: list[float]) -> None:
            self._u = value

    monkeypatch.setattr("obelisk_control_msgs.msg.PositionSetpoint", PositionSetpoint)
    add_field_aliases()
    message = PositionSetpoint()
    message.u_mujoco = [1.0]  # type: ignore[attr-defined]
    assert message.u == [1.0]
