"""States and transitions from launchers on this host, with the ROS graph as fallback."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.introspect import lifecycle
from obk_cli.introspect.lifecycle import (
    LifecycleRequest,
    change_states,
    node_states,
    possible_transitions,
)
from obk_cli.launch.events import Answered, ChangeRequested, InputEvent
from obk_cli.ros import lifecycle_client
from obk_cli.ros.environment import RosEnvironment
from obk_cli.runs import registry
from obk_cli.runs.protocol import Member

from ..runs.fake_stack import CONTROL, JOY, ROBOT, FakeStack, fake_stack  # noqa: TID252 - shared by folders of tests

ACTIVE = {ROBOT: "active", CONTROL: "active"}
OTHER = {"/left/obelisk_control_1": "inactive"}


class FakeRos:
    """The ROS graph as a table."""

    def __init__(self, states: Mapping[str, str], faults: Mapping[str, str]) -> None:
        self.states = dict(states)
        self.faults = faults

    def find(self, expected: object, timeout_s: float, quiet_s: float) -> tuple[str, ...]:
        return tuple(self.states)

    def state(self, node: str, timeout_s: float) -> str | None:
        return self.states.get(node)

    def change(self, node: str, transition: str, timeout_s: float) -> Answered | None:
        if node not in self.states:
            return None
        fault = self.faults.get(node, "")
        if not fault:
            self.states[node] = {"activate": "active"}.get(transition, "inactive")
        return Answered(node=node, transition=transition, success=not fault, fault=fault)


@pytest.fixture
def parent(tmp_path: Path) -> Path:
    return tmp_path / "runs"


@pytest.fixture
def environment(tmp_path: Path) -> RosEnvironment:
    variables = {"OBK_HOME": str(tmp_path), "ROS_DOMAIN_ID": "7"}
    return RosEnvironment(variables=variables, range="LOCALHOST", notes=())


def in_graph(
    monkeypatch: pytest.MonkeyPatch,
    states: Mapping[str, str],
    faults: Mapping[str, str] | None = None,
) -> None:
    @contextmanager
    def open_fake(name: str, environment: RosEnvironment, kind: object) -> Iterator[FakeRos]:
        yield FakeRos(states, faults or {})

    monkeypatch.setattr(lifecycle_client, "open_client", open_fake)


def changes(stack: FakeStack) -> list[tuple[str, tuple[str, ...], float | None]]:
    asked: list[InputEvent] = [
        event for event in stack.received if isinstance(event, ChangeRequested)
    ]
    return [(a.transition, a.nodes, a.timeout_s) for a in asked if isinstance(a, ChangeRequested)]


def test_a_stack_of_this_host_is_queried_without_ros(
    parent: Path, environment: RosEnvironment
) -> None:
    with fake_stack(parent, {**ACTIVE, JOY: ""}) as stack:
        assert node_states(environment, LifecycleRequest()) == ACTIVE
        assert node_states(environment, LifecycleRequest(names=("control",))) == {CONTROL: "active"}
        stack.hung.add(ROBOT)
        assert node_states(environment, LifecycleRequest()) == {
            ROBOT: "no answer",
            CONTROL: "active",
        }


def test_a_change_goes_to_the_launcher(parent: Path, environment: RosEnvironment) -> None:
    with fake_stack(parent, ACTIVE) as stack:
        answer = change_states(environment, "deactivate", LifecycleRequest(timeout_s=2.0))
        assert answer.success
        assert [member.node for member in answer.members] == [ROBOT, CONTROL]
        change_states(environment, "activate", LifecycleRequest(names=("control_0", "robot")))
        assert changes(stack) == [
            ("deactivate", (), 2.0),
            ("activate", (ROBOT, CONTROL), None),
        ]


def test_the_launchers_rejection_is_reported_with_each_member(
    parent: Path, environment: RosEnvironment
) -> None:
    with fake_stack(parent, ACTIVE) as stack:
        stack.broken.add(CONTROL)
        answer = change_states(environment, "deactivate", LifecycleRequest())
    assert not answer.success
    assert answer.why == f"{CONTROL}: no torque"
    assert [(m.node, m.result) for m in answer.members] == [
        (ROBOT, "reached"),
        (CONTROL, "refused"),
    ]


def test_of_several_stacks_a_change_is_of_the_one_that_is_named(
    parent: Path, environment: RosEnvironment
) -> None:
    with fake_stack(parent, ACTIVE) as dummy, fake_stack(parent, OTHER, name="left") as left:
        assert node_states(environment, LifecycleRequest()) == {**ACTIVE, **OTHER}
        assert node_states(environment, LifecycleRequest(run="left")) == OTHER
        assert change_states(environment, "activate", LifecycleRequest(run="left")).success
        assert change_states(
            environment, "deactivate", LifecycleRequest(names=("control_0",))
        ).success
        assert change_states(
            environment, "activate", LifecycleRequest(run=dummy.folder.name)
        ).success
        for names in ((), ("control",)):
            with pytest.raises(
                MisuseError, match="several stacks are running in ROS domain 7: d"
            ) as e:
                change_states(environment, "deactivate", LifecycleRequest(names=names))
        assert e.value.help == "choose one with `--run NAME`, or use full node names"
        assert len(changes(left)) == 1
        assert len(changes(dummy)) == 2


def test_of_two_launchers_of_one_stack_the_one_with_the_nodes_is_used_otherwise_the_lead(
    parent: Path, environment: RosEnvironment
) -> None:
    robot, control = {ROBOT: "active"}, {CONTROL: "active"}
    with (
        fake_stack(
            parent, control, devices=("offboard",), elsewhere={ROBOT: "unknown"}
        ) as offboard,
        fake_stack(
            parent, robot, devices=("onboard",), elsewhere={CONTROL: "unknown"}, leads=False
        ) as onboard,
    ):
        assert node_states(environment, LifecycleRequest()) == ACTIVE
        assert change_states(environment, "deactivate", LifecycleRequest()).success
        assert (len(changes(onboard)), len(changes(offboard))) == (0, 1)
        assert change_states(environment, "deactivate", LifecycleRequest(names=("robot",))).success
        assert (len(changes(onboard)), len(changes(offboard))) == (1, 1)


def test_a_missing_run_is_reported_with_similar_names(
    parent: Path, environment: RosEnvironment
) -> None:
    with (
        fake_stack(parent, ACTIVE),
        pytest.raises(
            CommandFailedError, match="no stack `dumy` is running in ROS domain"
        ) as raised,
    ):
        node_states(environment, LifecycleRequest(run="dumy"))
    assert raised.value.help == "did you mean `dummy`?"


def test_the_graph_is_used_if_no_launcher_has_the_nodes(
    parent: Path, environment: RosEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_graph(monkeypatch, {**ACTIVE, "/nav": "inactive"})
    with fake_stack(parent, ACTIVE):
        assert node_states(environment, LifecycleRequest(names=("nav",))) == {"/nav": "inactive"}
        with pytest.raises(CommandFailedError, match="no lifecycle node `contrl_0`") as raised:
            node_states(environment, LifecycleRequest(names=("contrl_0",)))
    assert raised.value.help == f"did you mean `{CONTROL}`?"


def test_the_graph_is_used_if_the_launcher_does_not_reply(
    parent: Path, environment: RosEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_graph(monkeypatch, {ROBOT: "inactive"})
    monkeypatch.setattr(registry, "ask_status", lambda *_: None)
    with fake_stack(parent, ACTIVE):
        assert node_states(environment, LifecycleRequest()) == {
            ROBOT: "inactive",
            CONTROL: "no answer",
        }
        answer = change_states(environment, "activate", LifecycleRequest())
    assert answer.why == f"{CONTROL}: no answer to `activate` within 10 s"
    assert [(m.node, m.result) for m in answer.members] == [
        (ROBOT, "reached"),
        (CONTROL, "timed out"),
    ]


def test_in_the_graph_the_state_node_is_left_out_and_control_stops_first(
    environment: RosEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_graph(monkeypatch, {"/dummy": "active", **ACTIVE})
    assert node_states(environment, LifecycleRequest()) == ACTIVE
    assert node_states(environment, LifecycleRequest(names=("dummy",))) == {"/dummy": "active"}
    answer = change_states(environment, "deactivate", LifecycleRequest())
    assert [member.node for member in answer.members] == [CONTROL, ROBOT]


@pytest.mark.parametrize(
    ("transition", "fault"),
    [
        ("activate", "`activate` failed: no torque"),
        ("configure", "`configure` requires state unconfigured, but the node is active"),
    ],
)
def test_in_the_graph_a_rejection_has_a_reason(
    environment: RosEnvironment, monkeypatch: pytest.MonkeyPatch, transition: str, fault: str
) -> None:
    state = "inactive" if transition == "activate" else "active"
    in_graph(monkeypatch, {ROBOT: state}, {ROBOT: "no torque"})
    answer = change_states(environment, transition, LifecycleRequest())
    assert answer.members == (Member(node=ROBOT, result="refused", state=state, fault=fault),)
    assert answer.why == f"{ROBOT}: {fault}"


def test_an_empty_domain_is_reported_with_the_domains_in_use(
    parent: Path, environment: RosEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_graph(monkeypatch, {})
    with pytest.raises(CommandFailedError, match="in ROS domain 7") as none:
        node_states(environment, LifecycleRequest())
    assert none.value.help is not None
    assert none.value.help.startswith("start a stack with `obk launch`")
    with fake_stack(parent, ACTIVE, domain=8), pytest.raises(CommandFailedError) as elsewhere:
        node_states(environment, LifecycleRequest())
    assert elsewhere.value.help == "a stack is running in ROS domain 8; set ROS_DOMAIN_ID"


def test_the_transitions_that_are_possible_depend_on_the_state() -> None:
    assert possible_transitions("inactive") == ("activate", "cleanup", "shutdown")
    assert possible_transitions("finalized") == ()


def test_over_ros_a_given_limit_is_for_discovery_and_for_responses(
    environment: RosEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[float] = []

    class Patient(FakeRos):
        def find(self, expected: object, timeout_s: float, quiet_s: float) -> tuple[str, ...]:
            waits.append(timeout_s)
            return super().find(expected, timeout_s, quiet_s)

        def state(self, node: str, timeout_s: float) -> str | None:
            waits.append(timeout_s)
            return super().state(node, timeout_s)

    @contextmanager
    def open_patient(name: str, environment: RosEnvironment, kind: object) -> Iterator[Patient]:
        yield Patient(ACTIVE, {})

    monkeypatch.setattr(lifecycle_client, "open_client", open_patient)
    for limit_s, expected in (
        (30.0, [30.0, 30.0]),
        (None, [lifecycle.DISCOVERY_S, lifecycle.ANSWER_S]),
    ):
        waits.clear()
        asked = LifecycleRequest(names=(ROBOT,), timeout_s=limit_s)
        assert node_states(environment, asked) == {ROBOT: "active"}
        assert waits == expected
