"""A running arm as displayed: message ages along the data path, rates of a slow simulation."""

import json
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest

from .stack import OBK, calm, eventually, launched, obk

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

WAY = ("/arm/encoders", "/arm/est", "/arm/ctrl")


@pytest.fixture
def arm(tmp_path: Path, repository: Path) -> Path:
    """The example at 10 Hz."""
    folder = tmp_path / "arm"
    shutil.copytree(repository / "examples" / "arm", folder)
    calm(folder)
    return folder / "arm.yaml"


def monitored() -> Mapping[str, Any]:
    """The topics of the data path as `obk monitor` reports them."""
    result = obk("monitor", "--once", "--format", "json", "--period", "2")
    assert result.returncode == 0, result.stderr
    return {topic["topic"]: topic for topic in json.loads(result.stdout)["topics"]}


def delay(topic: str) -> Any:
    """The output of `obk topic delay`, after it has received messages."""
    reported: list[str] = []

    def is_reported() -> bool:
        result = obk("topic", "delay", topic, "--duration", "1.5", "--format", "json")
        reported.append(result.stdout)
        return result.returncode == 0

    eventually(is_reported, f"a delay of {topic}")
    return json.loads(reported[-1])


@contextmanager
def paged() -> Iterator[Callable[[], Mapping[str, Any]]]:
    """The same topics as `obk web` sends them to its page, event by event."""
    pytest.importorskip("starlette", reason="starlette is in the `web` extra")
    process = subprocess.Popen([OBK, "web", "--port", "0"], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        url = process.stdout.readline().split()[-1]
        with urlopen(url.replace("/?", "/events?"), timeout=60) as events:

            def reported() -> Mapping[str, Any]:
                for line in events:
                    name, _, data = line.decode().partition(": ")
                    if name == "data" and "topics" in (view := json.loads(data)):
                        return {topic["topic"]: topic for topic in view["topics"]}
                raise AssertionError("the page was reported no topics")

            yield reported
    finally:
        process.send_signal(signal.SIGINT)
        process.stdout.close()
        assert process.wait(60) == 0


def is_carried(topics: Mapping[str, Any]) -> bool:
    """Whether the ages of estimate and command are those of the underlying measurement."""
    ages = [topics[name]["age"] for name in WAY]
    return all(ages) and [age["is_carried"] for age in ages] == [False, True, True]


@pytest.mark.slow
def test_the_age_of_a_command_is_that_of_the_measurement_in_it(arm: Path) -> None:
    with launched(arm, "--set", "obk.use_sim_time=false"):
        eventually(lambda: is_carried(monitored()), "stamps that are handed on")
        for name in WAY:
            reported = delay(name)
            assert not reported["is_relative"]
            assert 0 < reported["mean_s"] < 60
        with paged() as topics:
            eventually(lambda: is_carried(topics()), "the same on the page")


@pytest.mark.slow
def test_a_simulation_at_half_speed_keeps_its_rates_and_its_ages_are_in_its_time(
    arm: Path,
) -> None:
    with launched(arm, "--set", "robot.params.realtime_factor=0.5"):

        def is_kept() -> bool:
            topics = monitored()
            # Only after the robot has reported its real-time factor.
            is_half = [topics[name]["expected_hz"] for name in WAY] == [5.0, 5.0, 5.0]
            return is_half and not any(topics[name]["is_off"] for name in WAY)

        eventually(is_kept, "rates that are kept")
        eventually(lambda: is_carried(monitored()), "stamps that are handed on")
        found = delay("/arm/ctrl")
        assert found["is_simulated"]
        assert not found["is_relative"]
        assert 0 <= found["mean_s"] < 60
