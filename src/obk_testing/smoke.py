"""The default test of a config without tests: 5 s without a fault, and reproducible.

`obk test my_robot.yaml` runs it. It checks conditions that hold for any stack: no node fails, every
state and message is finite, topics are published at the rates in the config, the robot accepts its
commands, and a second run is bitwise equal.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest

from obelisk_py.core.robot import non_finite_number
from obk_cli.plan.plan import Plan
from obk_testing.result import TrialResult
from obk_testing.topic_log import TopicLog

if TYPE_CHECKING:  # the plugin changes the environment of the process that imports it
    from obk_testing.plugin import StartStack

DURATION_S: Final = 5.0
_SETTLED_S: Final = 1.0
"""Rates are measured after this time; commands may be rejected until then [s]."""
_TOLERANCE: Final = 0.1
"""Tolerance of a rate, as a fraction of it."""
_DRAWN: Final = ("Image", "CameraInfo", "MarkerArray", "Marker")
"""Messages that are not requested: images need OpenGL and take most of the time."""
_MAY_BE_INFINITE: Final = ("LaserScan", "Range", "PointCloud2", "ObkScan", "MultiEchoLaserScan")
"""Messages in which a number that is not finite means that nothing is in range (REP 117)."""
_REJECTED: Final = "control rejected"
"""Start of the robot's report about rejected commands."""


def test_smoke(
    stack: "StartStack", seed: int, given_plan: Plan, describe_check: Callable[[str], None]
) -> None:
    """Run the stack twice and check conditions that hold for any stack."""
    expected = expected_rates(given_plan)
    trial = stack(seed=seed, watch=expected)
    run = trial.run(DURATION_S)
    problems = [*problems_of(run, expected)]
    if problems:
        pytest.fail("\n".join(problems), pytrace=False)
    again = stack(seed=seed, watch=expected).run(DURATION_S)
    difference = run.first_difference(again)
    if difference is not None:
        pytest.fail(f"a second run differs, first at {difference}", pytrace=False)
    count = sum(1 for topic in run.topics.values() if len(topic))
    factor = DURATION_S / trial.wall_s if trial.wall_s else float("inf")
    describe_check(
        f"{DURATION_S:g} s of {given_plan.name} at {factor:.1f}x: "
        f"{len(given_plan.nodes)} nodes, {count} topics, {len(expected)} at their rates, "
        "no fault, twice the same bits",
    )


def expected_rates(plan: Plan) -> dict[str, float]:
    """Return topic -> total rate that the config sets for all of its publishers [Hz]."""
    rates: defaultdict[str, list[float | None]] = defaultdict(list)
    for node in plan.nodes:
        for end in node.publishes:
            drawn = (end.msg_type or "").rpartition("/")[2] in _DRAWN
            rates[end.topic].append(None if drawn else end.rate_hz)
    return {
        topic: sum(rate for rate in all_rates if rate is not None)
        for topic, all_rates in rates.items()
        if None not in all_rates
    }


def problems_of(run: TrialResult, expected: dict[str, float]) -> Iterator[str]:
    """Yield the problems of a run, one sentence each."""
    yield from run.faults
    if run.states is not None:
        for name, values in (("positions", run.qpos), ("velocities", run.qvel)):
            rows = np.nonzero(~np.isfinite(values).all(axis=1))[0]
            if len(rows):
                yield f"the {name} of the simulator are not finite at {run.t[rows[0]]:.3f} s"
    for name, topic in run.topics.items():
        yield from _not_finite(name, topic)
    for name, rate_hz in expected.items():
        yield from _wrong_rate(name, run.topics.get(name), rate_hz)
    rejected = [
        entry
        for entry in run.log
        if entry.text.startswith(_REJECTED) and entry.time_ns * 1e-9 > DURATION_S - _SETTLED_S
    ]
    if rejected:
        yield f"{rejected[-1].name} still reports after {DURATION_S - _SETTLED_S:g} s: " + (
            rejected[-1].text
        )


def _not_finite(name: str, topic: TopicLog) -> Iterator[str]:
    if topic.message_class.__name__ in _MAY_BE_INFINITE:
        return
    for t, message in zip(topic.t, topic.messages, strict=True):
        number = non_finite_number(message)
        if number is not None:
            yield f"{name}: {number} at {t:.3f} s"
            return


def _wrong_rate(name: str, topic: TopicLog | None, rate_hz: float) -> Iterator[str]:
    times = () if topic is None else topic.t[topic.t >= _SETTLED_S]
    span_s = DURATION_S - _SETTLED_S
    measured_hz = len(times) / span_s
    # One message more or less does not change the rate.
    if abs(measured_hz - rate_hz) > _TOLERANCE * rate_hz + 1.0 / span_s:
        yield f"{name} is published at {measured_hz:.1f} Hz, expected {rate_hz:g} Hz"
