"""Events from reports of nodes: transitions and rates."""

from collections.abc import Callable, Iterator
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any

import pytest

from obelisk_spec.runtime_protocol import Rate, rate_values
from obk_cli.launch import ros_nodes
from obk_cli.launch.events import (
    UNKNOWN_FAULT,
    ActivationReported,
    RatesReported,
    StateSeen,
    TransitionStarted,
)
from obk_cli.launch.ros_nodes import (
    NodeWatch,
    activation_of,
    event_of_transition,
    failed_transition,
    rates_of,
    subscribe_to_diagnostics,
)


def test_an_event_begins_a_transition_ends_one_or_fails() -> None:
    begun = event_of_transition("/n", "inactive", "activating")
    assert begun == TransitionStarted(node="/n", transition="activate")
    seen = event_of_transition("/n", "activating", "active")
    assert seen == StateSeen(node="/n", state="active", transition="activate")
    assert event_of_transition("/n", "activating", "errorprocessing") is None
    recovered = event_of_transition("/n", "errorprocessing", "unconfigured")
    assert recovered == StateSeen(node="/n", state="unconfigured")


@pytest.mark.parametrize("passed", ["configure", "activate", "shutdown"])
def test_these_transitions_need_a_request(passed: str) -> None:
    assert failed_transition(passed, "on_configure: ValueError: x") == passed


@pytest.mark.parametrize("passed", ["deactivate", "cleanup"])
def test_these_transitions_show_the_failed_step(passed: str) -> None:
    assert failed_transition(passed, f"on_{passed}: ValueError: x") == passed
    assert failed_transition(passed, "Controller.compute_control: ValueError: x") == ""
    assert failed_transition(passed, "") == passed
    assert failed_transition(passed, UNKNOWN_FAULT) == passed


class Clients:
    """A node with a `last_error` service, which answers when a test calls `answer`."""

    def __init__(self) -> None:
        self.answers: list[Callable[[Any], None]] = []

    def is_ready(self, _node: str, service: str) -> bool:
        return service == "last_error"

    def ask_fault(self, _node: str) -> Any:
        return SimpleNamespace(add_done_callback=self.answers.append)

    def answer(self, fault: str) -> None:
        message = SimpleNamespace(message=fault)
        self.answers.pop()(SimpleNamespace(result=lambda: message))


@pytest.fixture
def clients() -> Clients:
    return Clients()


@pytest.fixture
def watch(clients: Clients, monkeypatch: pytest.MonkeyPatch) -> Iterator[NodeWatch]:
    watch = NodeWatch(None, clients, lambda _: None)  # type: ignore[arg-type]
    monkeypatch.setattr(watch, "prepare", lambda _: None)
    yield watch
    watch.close()


def test_a_fault_is_reported_once(watch: NodeWatch, clients: Clients) -> None:
    faults: list[str] = []
    watch.watch(["/n"])
    watch.report_fault("/n", faults.append)
    clients.answer("no gain")
    assert faults == ["no gain"]


def test_a_fault_that_is_not_reported_in_time_is_unknown(
    watch: NodeWatch, clients: Clients, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros_nodes, "FAULT_S", 0.0)
    faults: SimpleQueue[str] = SimpleQueue()
    watch.watch(["/n"])
    watch.report_fault("/n", faults.put)
    assert faults.get(timeout=10) == UNKNOWN_FAULT
    clients.answer("no gain")
    assert faults.empty()


def test_a_fault_of_a_previous_process_is_not_reported(watch: NodeWatch, clients: Clients) -> None:
    faults: list[str] = []
    watch.watch(["/n"])
    watch.report_fault("/n", faults.append)
    watch.watch(["/n"])
    clients.answer("no gain")
    assert faults == []


RATE = Rate(
    name="timer_ctrl",
    expected_hz=100.0,
    measured_hz=87.5,
    ticks=42,
    overruns=3,
    late_p50_us=81.9,
    late_p99_us=2752.5,
    late_max_us=3000.0,
    standing="off",
)


def status(name: str, node: str, values: tuple[tuple[str, str], ...]) -> Any:
    pairs = [SimpleNamespace(key=key, value=value) for key, value in values]
    return SimpleNamespace(level=b"\x01", name=name, hardware_id=node, values=pairs)


def test_other_diagnostics_are_ignored() -> None:
    own = status("c: timer_ctrl", "/c", rate_values(RATE))
    other = status("c: motor", "/c", (("celsius", "41"),))
    assert rates_of(SimpleNamespace(status=[other, own])) == RatesReported(node="/c", rates=(RATE,))


def test_diagnostics_without_rates_are_ignored() -> None:
    assert rates_of(SimpleNamespace(status=[])) is None
    assert rates_of(SimpleNamespace(status=[status("lidar: x", "lidar", ())])) is None


def test_an_activation_without_a_time_is_ignored() -> None:
    own = status("c: active_since_s", "/c", (("active_since_s", "0.024"),))
    first = status("c: first_output_s", "/c", (("first_output_s", "0.03"),))
    assert activation_of(SimpleNamespace(status=[own])) == ActivationReported(
        node="/c", simulated_s=0.024
    )
    assert activation_of(SimpleNamespace(status=[first, own])) == ActivationReported(
        node="/c", simulated_s=0.024, first_output_s=0.03
    )
    assert activation_of(SimpleNamespace(status=[first])) is None
    for name, text in (("c: active_since_s", "nan"), ("c: active_since_s", "x"), ("c: x", "0.1")):
        wrong = status(name, "/c", (("active_since_s", text),))
        assert activation_of(SimpleNamespace(status=[wrong])) is None


def test_only_subscribed_nodes_are_received() -> None:
    received: list[RatesReported] = []
    callbacks: list[Any] = []
    node = SimpleNamespace(create_subscription=lambda *given: callbacks.append(given[2]))
    subscribe_to_diagnostics(node, ("/c", "/d"), received.append)
    for name in ("/c", "/elsewhere", "/d"):
        callbacks[0](SimpleNamespace(status=[status("c: timer_ctrl", name, rate_values(RATE))]))
    assert [reported.node for reported in received] == ["/c", "/d"]
