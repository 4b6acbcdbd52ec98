"""The expected reactions to a fault, and the cases made from them."""

import re
from pathlib import Path

import pytest

from obk_cli.faultinject.expectations import Allowances, Fault, Reaction, expectation_of, make_cases
from obk_cli.launch.process_groups import Unit
from obk_cli.plan.plan import OnCrash

from .made_up import CONTROLLER, ESTIMATOR, NODES, ROBOT, process, unit


@pytest.mark.parametrize(
    ("rule", "reaction"), [("stop", "stop"), ("restart", "restart"), ("ignore", "go on")]
)
@pytest.mark.parametrize("fault", ["freeze", "kill"])
def test_the_rule_determines_the_reaction(fault: Fault, rule: OnCrash, reaction: Reaction) -> None:
    assert expectation_of(unit(ROBOT), fault, rule).reaction == reaction


@pytest.mark.parametrize("rule", ["stop", "restart", "ignore"])
def test_nothing_follows_from_a_delay(rule: OnCrash) -> None:
    assert expectation_of(unit(ROBOT), "delay", rule).reaction == "nothing"


def test_the_document_has_the_limits_of_the_usual_rule(repository: Path) -> None:
    page = (repository / "docs/how-to/rehearsing.md").read_text()
    rows = re.findall(r"^\w+_0 +(delay|freeze|kill) +(.+?)  +(.+?)  ", page, re.MULTILINE)
    assert rows
    for fault, expected, seen in rows:
        assert expected == seen == expectation_of(unit(ROBOT), fault, "stop").summary


def test_an_end_is_detected_sooner_than_a_hang() -> None:
    """From the page on launching: "seen within 100 ms", "seen within 2 s"."""
    assert expectation_of(unit(ROBOT), "kill", "stop").detected_s == 0.1
    assert expectation_of(unit(ROBOT), "freeze", "stop").detected_s == 2.0
    slow = Allowances(end_detected_s=3.0)
    assert expectation_of(unit(ROBOT), "kill", "stop", slow).detected_s == 3.0


def test_a_nodes_own_rule_precedes_the_launchs() -> None:
    own = Unit(name=ROBOT, nodes=(process(ROBOT, "ignore"),))
    assert expectation_of(own, "kill", "stop").reaction == "go on"


def test_for_nodes_in_one_process_the_strictest_rule_applies() -> None:
    both = Unit(name="/s/composed", nodes=(process(ROBOT, "ignore"), process(ESTIMATOR)))
    assert expectation_of(both, "kill", "restart").reaction == "restart"


def test_nodes_without_a_lifecycle_are_only_watched_for_their_end() -> None:
    joystick = Unit(name="/joy_stick_0", nodes=(process("/joy_robot_0", has_lifecycle=False),))
    assert expectation_of(joystick, "freeze", "stop").reaction == "nothing"
    assert expectation_of(joystick, "kill", "stop").reaction == "stop"


def test_cases_that_keep_the_stack_intact_come_first_and_share_a_launch() -> None:
    cases = make_cases([unit(node) for node in NODES], on_crash="ignore")
    assert [(case.fault, case.unit.name) for case in cases] == [
        (fault, node) for fault in ("delay", "freeze", "kill") for node in reversed(NODES)
    ]
    assert [case.leaves_stack_complete for case in cases] == [True] * 6 + [False] * 3


def test_only_requested_faults_become_cases() -> None:
    cases = make_cases([unit(node) for node in NODES], faults=["kill"], nodes=[CONTROLLER])
    assert [(case.fault, case.unit.name) for case in cases] == [("kill", CONTROLLER)]
    shared = make_cases([unit(*NODES)], faults=["kill"], nodes=[CONTROLLER])
    assert [case.unit.name for case in shared] == ["/s/composed"]
