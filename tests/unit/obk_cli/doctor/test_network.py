"""Checks of datagrams and of DDS discovery, in fake worlds."""

from dataclasses import replace

import pytest

from obk_cli.doctor.child import Trial
from obk_cli.doctor.network import (
    DiscoveryFacts,
    MulticastFacts,
    judge_discovery,
    judge_multicast,
)

from .findings import severities, the_one

MULTICAST = MulticastFacts(
    group="239.255.0.1", loopback_fault="", network_fault="", unicast_fault=""
)
DONE = Trial(end="done", stdout="{}", last_error="", seconds=1.0)
DISCOVERY = DiscoveryFacts(
    trial=DONE, domain=100, rmw="rmw_x", first_answer_s=0.4, round_trip_ms=0.7
)


def test_datagrams_that_arrive_are_well() -> None:
    assert severities(judge_multicast(MULTICAST)) == ["ok"]


def test_a_loopback_that_is_down_is_an_error() -> None:
    down = "Network is unreachable"
    world = replace(MULTICAST, unicast_fault=down, loopback_fault=down, network_fault=down)
    found = [*judge_multicast(world)]
    assert the_one(found, "error").fix == "sudo ip link set lo up"
    assert severities(found) == ["error"]  # the other findings follow from it


def test_multicast_that_fails_on_loopback_is_reported_with_the_fix() -> None:
    found = [*judge_multicast(replace(MULTICAST, loopback_fault="No such device"))]
    warned = the_one(found, "warning")
    assert warned.fix.startswith("sudo ip link set lo up multicast on")
    the_one(found, "ok")


def test_multicast_that_fails_on_the_network_is_noted() -> None:
    the_one(judge_multicast(replace(MULTICAST, network_fault="No such device")), "note")


def test_two_processes_that_receive_each_other_are_fine() -> None:
    found = the_one(judge_discovery(DISCOVERY), "ok")
    assert found.facts["rmw"] == "rmw_x"


def test_processes_that_take_long_to_discover_each_other_are_noted() -> None:
    the_one(judge_discovery(replace(DISCOVERY, first_answer_s=3.4)), "note")


@pytest.mark.parametrize(
    ("range_", "fix"),
    [
        (
            "OFF",
            "unset ROS_AUTOMATIC_DISCOVERY_RANGE    # OFF: nodes never discover each other",
        ),
        (
            "LOCALHOST",
            "obk doctor multicast && sudo nft list ruleset    # does a firewall block UDP?",
        ),
        ("SUBNET", "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST obk doctor discovery"),
    ],
)
def test_processes_that_never_discover_each_other_are_an_error(range_: str, fix: str) -> None:
    late = replace(DONE, end="timed out", seconds=10.0)
    world = replace(DISCOVERY, trial=late, first_answer_s=None, round_trip_ms=None, range=range_)
    found = the_one(judge_discovery(world), "error")
    assert found.fix == fix


@pytest.mark.parametrize(
    ("trial", "reported"),
    [
        (replace(DONE, end="failed", last_error="ImportError: x"), "failed: ImportError: x"),
        (replace(DONE, end="failed"), "failed: no output on stderr"),
        (replace(DONE, end="crashed", signal="SIGSEGV"), "was killed by SIGSEGV"),
    ],
)
def test_a_ros_process_that_does_not_get_so_far_is_an_error(trial: Trial, reported: str) -> None:
    world = replace(DISCOVERY, trial=trial, first_answer_s=None, round_trip_ms=None)
    assert the_one(judge_discovery(world), "error").message == f"a ROS process {reported}"


def test_without_rclpy_discovery_is_not_tried() -> None:
    assert the_one(judge_discovery(DiscoveryFacts(trial=None, domain=0)), "note")
