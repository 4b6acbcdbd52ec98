"""The speeds of simulated robots, with a function in the place of their nodes."""

from obk_cli.errors import CommandFailedError
from obk_cli.monitor.expected_topics import Speeds
from obk_cli.ros.parameters import NodeParameter
from obk_cli.runs.protocol import NodeStatus

EVENT = b"\x00\x01\x00\x00 /arm/r realtime_factor"


class Robots:
    """What the nodes answer, and who was asked."""

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


def test_a_robot_is_asked_once_it_is_configured() -> None:
    robots = Robots()
    speeds = Speeds({"/arm/r"}, robots.ask)
    for state in ("unconfigured", "inactive", "active"):
        speeds.look([status(state), status(state, "/arm/c")])
    assert (robots.asked, speeds.factors) == (["/arm/r"], {"/arm/r": 1.0})


def test_a_robot_whose_factor_was_set_is_asked_once_it_is_configured_anew() -> None:
    robots = Robots()
    speeds = Speeds({"/arm/r"}, robots.ask)
    speeds.look([status("active")])
    robots.factor = 0.5
    speeds.hear(0, b"/arm/r report_rates")
    speeds.look([status("active")])
    assert len(robots.asked) == 1
    speeds.hear(0, EVENT)
    speeds.look([status("unconfigured")])
    assert speeds.factors == {}
    speeds.look([status("inactive")])
    assert speeds.factors == {"/arm/r": 0.5}


def test_a_robot_that_does_not_answer_is_asked_again() -> None:
    robots = Robots()
    robots.factor = None
    speeds = Speeds({"/arm/r"}, robots.ask)
    speeds.look([status("active")])
    assert speeds.factors == {}
    robots.factor = 0.0
    speeds.look([status("active")])
    assert speeds.factors == {"/arm/r": 0.0}
