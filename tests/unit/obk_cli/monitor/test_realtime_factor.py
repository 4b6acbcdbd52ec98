"""The factors of simulated robots, with a function instead of their nodes."""

from obk_cli.errors import CommandFailedError
from obk_cli.monitor.expected_topics import RealtimeFactors
from obk_cli.ros.parameters import NodeParameter
from obk_cli.runs.protocol import NodeStatus

EVENT = b"\x00\x01\x00\x00 /arm/r realtime_factor"


class Robots:
    """The responses of the nodes, and the requested nodes."""

    def __init__(self) -> None:
        self.factor: float | None = 1.0
        self.asked: list[str] = []

    def ask(self, node: str) -> NodeParameter:
        self.asked.append(node)
        if self.factor is None:
            raise CommandFailedError("no answer")
        return NodeParameter(kind="double", value=self.factor)


def status(state: str, node: str = "/arm/r") -> NodeStatus:
    return NodeStatus(
        node=node,
        section="robot",
        device="onboard",
        state=state,
        process=node,
        pid=1,
        restarts=0,
        hangs=False,
    )


def test_a_robot_is_queried_once_it_is_configured() -> None:
    robots = Robots()
    factors = RealtimeFactors({"/arm/r"}, robots.ask)
    for state in ("unconfigured", "inactive", "active"):
        factors.query_missing([status(state), status(state, "/arm/c")])
    assert (robots.asked, factors.factors) == (["/arm/r"], {"/arm/r": 1.0})


def test_a_robot_whose_factor_was_set_is_queried_again_after_configure() -> None:
    robots = Robots()
    factors = RealtimeFactors({"/arm/r"}, robots.ask)
    factors.query_missing([status("active")])
    robots.factor = 0.5
    factors.take_event(0, b"/arm/r report_rates")
    factors.query_missing([status("active")])
    assert len(robots.asked) == 1
    factors.take_event(0, EVENT)
    factors.query_missing([status("unconfigured")])
    assert factors.factors == {}
    factors.query_missing([status("inactive")])
    assert factors.factors == {"/arm/r": 0.5}


def test_a_robot_that_does_not_respond_is_queried_again() -> None:
    robots = Robots()
    robots.factor = None
    factors = RealtimeFactors({"/arm/r"}, robots.ask)
    factors.query_missing([status("active")])
    assert factors.factors == {}
    robots.factor = 0.0
    factors.query_missing([status("active")])
    assert factors.factors == {"/arm/r": 0.0}
