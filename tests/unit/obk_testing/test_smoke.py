"""The errors in a run that the smoke test finds."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Float64

from obelisk_py.core.command_watchdog import RejectionLog
from obelisk_py.core.lockstep.interception import LogEntry
from obk_cli.plan.plan import Endpoint, Plan
from obk_testing.smoke import DURATION_S, expected_rates, problems_of
from obk_testing.topic_log import TopicLog

from ..obk_cli.plans import node  # noqa: TID252 - shared by folders of tests
from .test_result import result, topic

S = 1_000_000_000


def steady(rate_hz: float) -> range:
    """Times of messages at a rate [ms]."""
    return range(0, int(DURATION_S * 1000), int(1000 / rate_hz))


def at_rate(name: str, rate_hz: float) -> object:
    times = steady(rate_hz)
    return topic(name, *(Float64(data=1.0) for _ in times), times_ms=times)


def problems(*topics: object, expected: dict[str, float] | None = None) -> list[str]:
    return [*problems_of(result(*topics), expected or {})]


def test_a_valid_run_has_no_problem() -> None:
    assert problems(at_rate("/x", 100), expected={"/x": 100.0}) == []


@pytest.mark.parametrize("rate_hz", [50, 125])
def test_a_topic_has_the_rate_that_the_config_expects(rate_hz: int) -> None:
    (problem,) = problems(at_rate("/x", rate_hz), expected={"/x": 100.0})
    assert problem == f"/x is published at {rate_hz:.1f} Hz, expected 100 Hz"


def test_an_unpublished_topic_has_a_wrong_rate() -> None:
    assert problems(expected={"/x": 1.0}) == ["/x is published at 0.0 Hz, expected 1 Hz"]


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_are_finite(value: float) -> None:
    pose = PoseStamped()
    pose.pose.position.z = value
    (problem,) = problems(topic("/pose", PoseStamped(), pose))
    assert problem == f"/pose: `pose.position.z` is {value} at 0.001 s"


class FloatingState:
    """A message of a package whose name contains `float`."""

    def __init__(self, x: float | None) -> None:
        self.inner = None if x is None else FloatingState(None)
        self.x = x

    def get_fields_and_field_types(self) -> dict[str, str]:
        return {"inner": "floating_base_msgs/State", "x": "double"} if self.inner else {}


@pytest.mark.parametrize(("x", "count"), [(1.0, 0), (np.nan, 1)])
def test_names_of_packages_are_not_types_of_numbers(x: float, count: int) -> None:
    run = result()
    run.topics = {"/x": TopicLog("/x", FloatingState, [(0, 0, b"")], lambda _: FloatingState(x))}
    assert len([*problems_of(run, {})]) == count


def test_a_scanner_may_see_nothing() -> None:
    assert problems(topic("/scan", LaserScan(ranges=[np.inf]))) == []


def test_commands_are_accepted_at_the_end() -> None:
    log = RejectionLog("control rejected", lambda: 0.0)
    log.add("too short")
    report = log.report()
    assert report is not None
    for time_ns, count in ((S, 0), (int(4.5 * S), 1)):
        entry = LogEntry(time_ns=time_ns, severity=30, name="robot", text=report.text, place="x:1")
        run = result()
        run.log = (entry,)
        assert len([*problems_of(run, {})]) == count


def test_rates_of_all_publishers_count_and_pictures_do_not() -> None:
    ends = (
        Endpoint(topic="/a", msg_type="std_msgs/msg/Float64", rate_hz=100.0),
        Endpoint(topic="/b", msg_type="sensor_msgs/msg/Image", rate_hz=30.0),
        Endpoint(topic="/c", msg_type="std_msgs/msg/Float64"),
    )
    one, two = (node(name, publishes=ends) for name in ("one", "two"))
    assert expected_rates(Plan(name="stack", nodes=(one, two))) == {"/a": 200.0}
