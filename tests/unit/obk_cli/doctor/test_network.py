"""Judges of datagrams and of DDS discovery, in made-up worlds."""

from dataclasses import replace

import pytest

from obk_cli.doctor.network import (
    DiscoveryFacts,
    MulticastFacts,
    judge_discovery,
    judge_multicast,
)
from obk_cli.doctor.trial import Trial

from .findings import severities, the_one

MULTICAST = MulticastFacts(
    group="239.255.0.1", loopback_fault="", network_fault="", unicast_fault=""
)
DONE = Trial(end="done", said="{}", complaint="", seconds=1.0)
DISCOVERY = DiscoveryFacts(
    trial=DONE, domain=100, rmw="rmw_x", first_answer_s=0.4, round_trip_ms=0.7
)


def test_datagrams_that_arrive_are_well() -> None:
    assert severities(judge_multicast(MULTICAST)) == ["ok"]


def test_a_loopback_that_is_down_is_an_error() -> None:
    down = "Network is unreachable"
    world = replace(MULTICAST, unicast_fault=down, loopback_fault=down, network_fault=down)
    found = [*judge_multicast(world)]
    assert the_one(found, "error").cure == "sudo ip link set lo up"
    assert severities(found) == ["error"]  # the rest follows from it


def test_multicast_that_fails_on_loopback_is_told_with_the_cure() -> None:
    found = [*judge_multicast(replace(MULTICAST, loopback_fault="No such device"))]
    warned = the_one(found, "warning")
    assert warned.message.endswith("over loopback does not arrive: No such device")
    assert warned.cure.startswith("sudo ip link set lo up multicast on")
    assert the_one(found, "ok").message.endswith("arrives over the network")


def test_multicast_that_fails_on_the_network_is_noted() -> None:
    found = the_one(judge_multicast(replace(MULTICAST, network_fault="No such device")), "note")
    assert found.message == (
        "multicast to 239.255.0.1 over the network does not arrive: No such device; "
        "a stack on two hosts needs it, or their addresses"
    )


def test_two_processes_that_hear_each_other_are_well() -> None:
    found = the_one(judge_discovery(DISCOVERY), "ok")
    assert found.message == "two ROS processes heard each other after 0.4 s, round trip 0.7 ms"
    assert found.facts["rmw"] == "rmw_x"


def test_processes_that_take_long_to_hear_each_other_are_noted() -> None:
    found = the_one(judge_discovery(replace(DISCOVERY, first_answer_s=3.4)), "note")
    assert found.message == (
        "two ROS processes heard each other after 3.4 s, round trip 0.7 ms; "
        "stacks will be slow to come up"
    )


@pytest.mark.parametrize(
    ("range_", "cure"),
    [
        (
            "OFF",
            "unset ROS_AUTOMATIC_DISCOVERY_RANGE    # OFF: nodes never look for each other",
        ),
        (
            "LOCALHOST",
            "obk doctor multicast && sudo nft list ruleset    # does a firewall hold UDP up?",
        ),
        ("SUBNET", "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST obk doctor discovery"),
    ],
)
def test_processes_that_never_hear_each_other_are_an_error(range_: str, cure: str) -> None:
    late = replace(DONE, end="timed out", seconds=10.0)
    world = replace(DISCOVERY, trial=late, first_answer_s=None, round_trip_ms=None, range=range_)
    found = the_one(judge_discovery(world), "error")
    assert found.cure == cure
    assert found.message == ("two ROS processes of this host did not hear each other within 10 s")


@pytest.mark.parametrize(
    ("trial", "told"),
    [
        (replace(DONE, end="failed", complaint="ImportError: x"), "failed: ImportError: x"),
        (replace(DONE, end="failed"), "failed: it said nothing"),
        (replace(DONE, end="crashed", signal="SIGSEGV"), "was ended by SIGSEGV"),
    ],
)
def test_a_ros_process_that_does_not_get_so_far_is_an_error(trial: Trial, told: str) -> None:
    world = replace(DISCOVERY, trial=trial, first_answer_s=None, round_trip_ms=None)
    assert the_one(judge_discovery(world), "error").message == f"a ROS process {told}"


def test_without_rclpy_discovery_is_not_tried() -> None:
    assert the_one(judge_discovery(DiscoveryFacts(trial=None, domain=0)), "note")
