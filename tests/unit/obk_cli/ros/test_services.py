"""Service calls whose first response is lost, as happens before the node discovers the client."""

from types import SimpleNamespace
from typing import Any

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.ros import services as ros_calls
from obk_cli.ros.lifecycle_client import LifecycleClient
from obk_cli.ros.services import ServiceClient

GET_STATE = ros_calls.QUESTIONS["get_state"]


class LossyClient:
    """Responds from the second request on."""

    def __init__(self) -> None:
        self.asked = 0

    def service_server_is_available(self) -> bool:
        return True

    def send_request(self, request: object) -> int:
        self.asked += 1
        return self.asked

    def take_response(self, kind: object) -> tuple[Any, Any]:
        if self.asked < 2:
            return None, None
        return SimpleNamespace(request_id=SimpleNamespace(sequence_number=2)), "the answer"


class LossyNode:
    """Responds from the second request for its state on."""

    def __init__(self) -> None:
        self.asked = 0

    def open(self, node: str) -> None: ...

    def is_ready(self, node: str, service: str) -> bool:
        return True

    def ask_state(self, node: str) -> int:
        self.asked += 1
        return self.asked

    def answer(self, number: int, timeout_s: float) -> Any:
        state = SimpleNamespace(current_state=SimpleNamespace(label="active"))
        return state if number == 2 else None


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros_calls, "ASK_AGAIN_S", 0.002)


@pytest.fixture
def lossy() -> LossyClient:
    return LossyClient()


@pytest.fixture
def client(lossy: LossyClient) -> ServiceClient:
    made = object.__new__(ServiceClient)
    vars(made).update(
        _name="/n/get_state",
        _type=SimpleNamespace(Response=object),
        _participant=SimpleNamespace(wait_for=lambda probe, timeout_s: probe(), nodes=tuple),
        _client=lossy,
    )
    return made


def test_a_request_is_repeated(client: ServiceClient, lossy: LossyClient) -> None:
    assert client.call("request", 60.0, is_question=True) == "the answer"
    assert lossy.asked == 2


def test_what_may_change_something_is_asked_once(client: ServiceClient, lossy: LossyClient) -> None:
    with pytest.raises(CommandFailedError, match=r"/n/get_state did not answer within 0\.02 s"):
        client.call("request", 0.02)
    assert lossy.asked == 1


def test_a_request_for_a_nodes_state_is_repeated() -> None:
    ros, node = object.__new__(LifecycleClient), LossyNode()
    vars(ros).update(_clients=node, _wait=node.answer)
    assert ros.state("/n", 60.0) == "active"
    assert node.asked == 2


SERVICES = {
    "/n": {"/n/on": ("std_srvs/srv/Trigger",), "/n/get_state": (GET_STATE,)},
    "/m": {"/m/get_parameters": (ros_calls.QUESTIONS["get_parameters"],)},
}


@pytest.mark.parametrize(
    ("name", "asked"), [("/n/on", ["/n/get_state", "/n/on"]), ("/n/get_state", ["/n/get_state"])]
)
def test_a_node_is_queried_before_it_gets_a_request_with_side_effects(
    monkeypatch: pytest.MonkeyPatch, name: str, asked: list[str]
) -> None:
    sent: list[str] = []

    class Reported(LossyClient):
        def __init__(self, of: str) -> None:
            super().__init__()
            self._of = of

        def send_request(self, request: object) -> int:
            sent.append(self._of)
            self.asked = 2
            return 2

    def make(self: ServiceClient, participant: object, of: str, kind: object) -> None:
        vars(self).update(_name=of, _type=kind, _participant=participant, _client=Reported(of))

    monkeypatch.setattr(ServiceClient, "__init__", make)
    kind = SimpleNamespace(Request=object, Response=object)
    monkeypatch.setattr(ros_calls, "find_type", lambda _: kind)
    participant: Any = SimpleNamespace(
        wait_for=lambda probe, timeout_s: probe(),
        nodes=lambda: tuple(SERVICES),
        services_of=SERVICES.__getitem__,
    )
    assert ServiceClient(participant, name, kind).call("request", 60.0) == "the answer"
    assert sent == asked
