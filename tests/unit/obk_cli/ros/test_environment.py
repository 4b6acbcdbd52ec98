"""The environment of ROS processes."""

import os
from difflib import ndiff
from pathlib import Path
from xml.etree import ElementTree

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.ros.environment import (
    HIGHEST_DOMAIN,
    LAN_PROFILE,
    LOCALHOST_PROFILE,
    QUICK_PROFILE,
    RosEnvironment,
    ros_environment,
)


@pytest.fixture(autouse=True)
def _plain(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (
        "ROS_DOMAIN_ID",
        "ROS_AUTOMATIC_DISCOVERY_RANGE",
        "ROS_LOCALHOST_ONLY",
        "ROS_STATIC_PEERS",
        "RMW_IMPLEMENTATION",
        "FASTRTPS_DEFAULT_PROFILES_FILE",
        "FASTDDS_DEFAULT_PROFILES_FILE",
        "SKIP_DEFAULT_XML_FILE",
    ):
        monkeypatch.delenv(name, raising=False)


RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"


def discovery_range(environment: RosEnvironment) -> str:
    return environment.range


def reported_to_ros(environment: RosEnvironment) -> tuple[str, str]:
    """The discovery range and the file name of the Fast DDS settings."""
    variables = environment.variables
    return variables[RANGE], Path(variables.get(PROFILE, "")).name


def test_a_stack_is_visible_to_this_host_only_by_default() -> None:
    assert discovery_range(ros_environment()) == "LOCALHOST"
    assert discovery_range(ros_environment("lan")) == "SUBNET"


def test_an_empty_domain_is_unset_as_in_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "")
    environment = ros_environment()
    assert environment.domain == 0
    assert "ROS_DOMAIN_ID" not in environment.variables


def test_ros_gets_a_log_folder_if_the_home_is_read_only(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / "home").touch()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for name in ("ROS_HOME", "ROS_LOG_DIR"):
        monkeypatch.delenv(name, raising=False)
    environment = ros_environment()
    assert environment.variables["ROS_HOME"].startswith(str(tmp_path / "obk-ros-"))
    (note,) = environment.notes
    assert note.startswith("ROS cannot write its log files into")


def test_devices_on_several_hosts_find_each_other_by_default(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert discovery_range(ros_environment(devices_are_split=True)) == "SUBNET"
    here = ros_environment("localhost", devices_are_split=True)
    assert discovery_range(here) == "LOCALHOST"
    hint = "prevents the discovery of devices on other hosts; use `--network lan`"
    assert here.notes == (f"`--network localhost` {hint}",)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    kept = ros_environment(devices_are_split=True)
    assert discovery_range(kept) == "LOCALHOST"
    assert kept.notes == (f"ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST {hint}",)
    monkeypatch.setenv("ROS_STATIC_PEERS", "10.0.0.2")
    assert ros_environment(devices_are_split=True).notes == ()


def test_the_old_switch_is_respected_once_and_never_passed_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    here = ros_environment()
    assert (discovery_range(here), here.notes) == ("LOCALHOST", ())
    lan = ros_environment("lan")
    assert discovery_range(lan) == "SUBNET"
    assert lan.notes == ("ROS_LOCALHOST_ONLY=1 is ignored for `--network lan`",)
    assert "ROS_LOCALHOST_ONLY" not in lan.variables
    lan.put_into_effect()
    assert "ROS_LOCALHOST_ONLY" not in os.environ
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "0")
    assert discovery_range(ros_environment()) == "SUBNET"


def test_remote_peers_are_kept_unless_the_stack_is_local_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_STATIC_PEERS", "10.0.0.2")
    assert ros_environment().variables["ROS_STATIC_PEERS"] == "10.0.0.2"
    here = ros_environment("localhost")
    assert "ROS_STATIC_PEERS" not in here.variables
    assert here.notes == ("ROS_STATIC_PEERS=10.0.0.2 is ignored for `--network localhost`",)


def test_settings_of_fast_dds_stay_the_users(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FASTDDS_DEFAULT_PROFILES_FILE", "/mine.xml")
    assert reported_to_ros(ros_environment()) == ("LOCALHOST", "")


def test_files_in_the_working_folder_are_no_settings_of_the_user(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for network in ("localhost", "lan"):
        assert ros_environment(network).variables["SKIP_DEFAULT_XML_FILE"] == "1"
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", "/mine.xml")
    assert "SKIP_DEFAULT_XML_FILE" not in ros_environment().variables


def test_local_messages_use_udp_over_the_loopback_device_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert reported_to_ros(ros_environment()) == ("SYSTEM_DEFAULT", "dds_localhost.xml")
    assert reported_to_ros(ros_environment("lan")) == ("SUBNET", "dds_lan.xml")
    monkeypatch.setenv("ROS_STATIC_PEERS", "10.0.0.2")
    assert reported_to_ros(ros_environment()) == ("LOCALHOST", "dds_lan.xml")


def test_another_middleware_ignores_settings_of_fast_dds(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "librmw_another_cpp.so").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_another_cpp")
    assert reported_to_ros(ros_environment())[0] == "LOCALHOST"


@pytest.mark.parametrize("is_launcher", [False, True])
def test_a_nested_environment_is_created_again(
    monkeypatch: pytest.MonkeyPatch, is_launcher: bool
) -> None:
    outer = ros_environment().with_quick_discovery() if is_launcher else ros_environment()
    for name, value in outer.variables.items():
        monkeypatch.setenv(name, value)
    within = ros_environment()
    assert (within.range, reported_to_ros(within)) == (
        "LOCALHOST",
        ("SYSTEM_DEFAULT", "dds_localhost.xml"),
    )
    assert reported_to_ros(ros_environment("lan")) == ("SUBNET", "dds_lan.xml")


def differences(one: str, other: str) -> list[str]:
    """The elements in only one of two profiles: `+ tag: text` or `- tag: text`."""
    texts = (
        [
            f"{element.tag.rpartition('}')[2]}: {(element.text or '').strip()}"
            for element in ElementTree.parse(path).iter()
        ]
        for path in (one, other)
    )
    return [line for line in ndiff(*texts) if line[0] in "+-"]


def test_the_settings_for_the_lan_differ_in_addresses_and_first_announcements() -> None:
    found = differences(LAN_PROFILE, LOCALHOST_PROFILE)
    assert [line for line in found if line[0] == "-"] == ["- count: 30", "- nanosec: 100000000"]
    addresses = [line for line in found if "address: " in line]
    assert [line.rpartition(" ")[2] for line in addresses] == ["127.0.0.1", "127.0.0.1"]


def test_a_launcher_announces_itself_more_often_while_a_stack_starts() -> None:
    local = ros_environment()
    assert reported_to_ros(local.with_quick_discovery()) == ("SYSTEM_DEFAULT", "dds_quick.xml")
    assert sorted(differences(LOCALHOST_PROFILE, QUICK_PROFILE)) == [
        "+ count: 60",
        "+ nanosec: 50000000",
        "- count: 1",
        "- nanosec: 300000000",
    ]
    lan = ros_environment("lan")
    assert lan.with_quick_discovery() == lan


def test_every_domain_has_ports_for_discoverable_participants() -> None:
    """DDSI-RTPS 2.5, 9.6.2.3: the last of two ports of each participant."""
    most = next(
        int(element.text or 0)
        for element in ElementTree.parse(LOCALHOST_PROFILE).iter()
        if element.tag.endswith("maxInitialPeersRange")
    )
    assert 7400 + 250 * HIGHEST_DOMAIN + 11 + 2 * (most - 1) < 1 << 16


def test_settings_of_the_user_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    environment = ros_environment()
    assert environment.variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "OFF"
    assert environment.domain == 7
    assert environment.notes == (
        "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF prevents the nodes of a stack from discovering "
        "each other",
    )


def test_a_missing_middleware_is_replaced_and_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_nowhere")
    environment = ros_environment()
    assert environment.variables["RMW_IMPLEMENTATION"] == "rmw_fastrtps_cpp"
    assert environment.notes == (
        "RMW_IMPLEMENTATION=rmw_nowhere is not installed; using rmw_fastrtps_cpp",
    )


@pytest.mark.parametrize("domain", ["x", "-1", "233"])
def test_an_invalid_domain_is_rejected(monkeypatch: pytest.MonkeyPatch, domain: str) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    with pytest.raises(CommandFailedError, match=f"ROS_DOMAIN_ID={domain} is not a number from 0"):
        ros_environment()
