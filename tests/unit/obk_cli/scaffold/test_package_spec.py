from collections.abc import Callable

import pytest

from obk_cli.scaffold.message_code import has_header
from obk_cli.scaffold.package_spec import MessageType, PackageRequest, PackageSpec, check_request

from .owners import no_owner


def test_messages_are_resolved_to_their_packages(make_spec: Callable[..., PackageSpec]) -> None:
    spec = make_spec("estimator", "foo", est_msg="nav_msgs/Odometry", sensor_msg="ObkImu")
    assert spec.est.full == "nav_msgs/msg/Odometry"
    assert spec.sensor.module == "obelisk_sensor_msgs.msg"


@pytest.mark.parametrize(
    ("written", "spelling"),
    [
        ("PositionSetpoint", "PositionSetpoint"),
        ("obelisk_control_msgs/msg/PositionSetpoint", "PositionSetpoint"),
        ("my_msgs/Thrust", "my_msgs/msg/Thrust"),
        ("std_msgs/UInt8MultiArray", "std_msgs/msg/UInt8MultiArray"),
    ],
)
def test_a_config_uses_the_short_message_name_if_unambiguous(
    make_spec: Callable[..., PackageSpec], written: str, spelling: str
) -> None:
    assert make_spec(ctrl_msg=written).ctrl.spelling == spelling


def test_all_invalid_options_are_reported_together() -> None:
    request = PackageRequest(
        kind="controller", name="Foo", ctrl_msg="PositionSetpont", est_msg="x/y"
    )
    problems = check_request(request, owner_of=no_owner)
    assert isinstance(problems, tuple)
    name, ctrl, est = [problem.sentence for problem in problems]
    assert "`Foo`" in name
    assert ctrl.startswith("--ctrl-msg: ")
    assert est.startswith("--est-msg: ")
    assert problems[1].help is not None
    assert problems[1].help.startswith("did you mean `PositionSetpoint`?")


def test_a_message_that_an_obelisk_package_lacks_is_rejected() -> None:
    request = PackageRequest(kind="controller", name="foo", ctrl_msg="obelisk_control_msgs/Nothing")
    assert isinstance(check_request(request, owner_of=no_owner), tuple)


class ArmMessages:
    """One package, one message."""

    def message_names(self, package: str) -> tuple[str, ...] | None:
        return ("Reach",) if package == "arm_msgs" else None

    def message_definition(self, package: str, name: str) -> str | None:
        return "# a\nstd_msgs/Header header\nfloat64 far\n"


def test_a_message_of_the_workspace_is_stamped_if_its_definition_has_a_header() -> None:
    request = PackageRequest(kind="controller", name="foo", ctrl_msg="arm_msgs/Reach")
    known = check_request(request, owner_of=no_owner, messages=ArmMessages())
    unknown = check_request(request, owner_of=no_owner)
    assert isinstance(known, PackageSpec)
    assert isinstance(unknown, PackageSpec)
    assert known == unknown
    assert [has_header(spec.ctrl) for spec in (known, unknown)] == [True, False]


def test_a_message_that_a_package_of_the_workspace_lacks_is_rejected() -> None:
    request = PackageRequest(kind="controller", name="foo", ctrl_msg="arm_msgs/Raech")
    problems = check_request(request, owner_of=no_owner, messages=ArmMessages())
    assert isinstance(problems, tuple)
    assert problems[0].sentence == "--ctrl-msg: package `arm_msgs` has no message `Raech`"
    assert problems[0].help == "did you mean `arm_msgs/Reach`?"
    request = PackageRequest(
        kind="controller", name="foo", ctrl_msg="arm_msgs/Reach", est_msg="later_msgs/State"
    )
    assert isinstance(
        check_request(request, owner_of=no_owner, messages=ArmMessages()), PackageSpec
    )


def test_two_messages_of_one_class_name_are_rejected() -> None:
    request = PackageRequest(
        kind="controller", name="foo", ctrl_msg="a_msgs/State", est_msg="b_msgs/State"
    )
    problems = check_request(request, owner_of=no_owner)
    assert isinstance(problems, tuple)
    assert problems[0].sentence == (
        "`a_msgs/msg/State` and `b_msgs/msg/State` have the same class name `State`"
    )


@pytest.mark.parametrize("clash", ["my_msgs/FooController", "my_msgs/ObeliskController"])
def test_a_message_with_the_name_of_another_class_of_the_module_is_rejected(clash: str) -> None:
    request = PackageRequest(kind="controller", name="foo", ctrl_msg=clash)
    problems = check_request(request, owner_of=no_owner)
    assert isinstance(problems, tuple)
    assert "has the name of a class" in problems[0].sentence


def test_the_same_message_in_and_out_is_fine(make_spec: Callable[..., PackageSpec]) -> None:
    assert make_spec(ctrl_msg="JointState", est_msg="JointState").ctrl == MessageType(
        package="sensor_msgs", name="JointState"
    )


@pytest.mark.parametrize(
    ("name", "class_name"),
    [
        ("foo", "FooController"),
        ("foo_controller", "FooController"),
        ("leg_2_pd", "Leg2PdController"),
        ("controller", "ControllerController"),
    ],
)
def test_the_class_is_named_after_the_node_and_its_kind(
    make_spec: Callable[..., PackageSpec], name: str, class_name: str
) -> None:
    assert make_spec(name=name).class_name == class_name
