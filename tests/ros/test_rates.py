"""Rates of real nodes: slow nodes are reported as broken, healthy nodes are not.

Broken rates are broken by construction: a callback takes five periods. Healthy rates are those of
timers so slow that load does not matter.
"""

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.task import Future
from rosgraph_msgs.msg import Clock

from obelisk_py.core.executor import EventLoopExecutor
from obelisk_py.core.node import ObeliskNode
from obelisk_spec.runtime_protocol import DIAGNOSTICS_TOPIC, Rate
from obk_cli.launch.events import RatesReported
from obk_cli.launch.ros_nodes import rates_of, subscribe_to_diagnostics

from .stack import EXAMPLE, eventually, launched, marked, obk, parameters, request
from .test_failures import with_faulty_controller

pytestmark = pytest.mark.ros

SLOW_PERIOD_S, FAST_PERIOD_S = 0.5, 0.001


class Two(ObeliskNode):
    """A timer that keeps its rate, and one whose callback takes longer than its period."""

    def __init__(self, **given: Any) -> None:
        settings = {
            "timer_slow_setting": f"{{timer_period_sec: {SLOW_PERIOD_S}}}",
            "timer_fast_setting": f"{{timer_period_sec: {FAST_PERIOD_S}}}",
            **given,
        }
        super().__init__("two", namespace="/arm", **parameters(**settings))
        self.register_obk_timer("timer_slow_setting", self.pass_by)
        self.register_obk_timer("timer_fast_setting", self.dawdle)
        self.create_timer(0.1, self.pass_by)

    def pass_by(self) -> None:
        """Nothing."""

    def dawdle(self) -> None:
        """Sleep for five periods."""
        time.sleep(5 * FAST_PERIOD_S)


class Awaiting(Two):
    """Callbacks that are coroutines."""

    async def pass_by(self) -> None:  # type: ignore[override]
        """Nothing."""

    async def dawdle(self) -> None:  # type: ignore[override]
        """Nothing."""


@contextmanager
def listening(
    make: Callable[[], ObeliskNode], executor_type: Callable[[], Executor]
) -> Iterator[tuple[ObeliskNode, list[RatesReported]]]:
    """An active node, and its rate reports."""
    rclpy.init()
    listener = rclpy.create_node("listener")
    node = make()
    received: list[RatesReported] = []
    subscribe_to_diagnostics(listener, (node.get_fully_qualified_name(),), received.append)
    executor = executor_type()
    for each in (node, listener):
        executor.add_node(each)
    over = Future()
    # rclpy's executors may raise when they are shut down while they spin.
    thread = threading.Thread(target=executor.spin_until_future_complete, args=(over,), daemon=True)
    thread.start()
    try:
        assert request(node, "configure")
        assert request(node, "activate")
        yield node, received
    finally:
        over.set_result(None)
        executor.wake()
        thread.join()
        executor.shutdown()
        node.destroy_node()
        listener.destroy_node()
        rclpy.try_shutdown()


NONE = Rate(
    name="",
    expected_hz=1.0,
    measured_hz=0.0,
    ticks=0,
    overruns=0,
    late_p50_us=0.0,
    late_p99_us=0.0,
    late_max_us=0.0,
)


def newest(received: list[RatesReported], name: str) -> Rate | None:
    return next((r for reported in received[-1:] for r in reported.rates if r.name == name), None)


def is_broken(received: list[RatesReported], name: str) -> bool:
    rate = newest(received, name)
    return rate is not None and rate.standing == "broken"


@pytest.mark.slow
@pytest.mark.parametrize(
    "executor_type",
    [
        EventLoopExecutor,
        lambda: EventLoopExecutor(3),
        SingleThreadedExecutor,
        MultiThreadedExecutor,
    ],
    ids=["own", "own, threads", "rclpy's, one thread", "rclpy's, threads"],
)
def test_a_throttled_timer_is_marked_with_every_executor(
    executor_type: Callable[[], Executor],
) -> None:
    with listening(Two, executor_type) as (_, received):
        eventually(
            lambda: is_broken(received, "timer_fast"), "a broken rate", seen=lambda: str(received)
        )
        rate = newest(received, "timer_fast")
    assert {reported.node for reported in received} == {"/arm/two"}
    assert [rate.name for rate in received[0].rates] == ["timer_slow", "timer_fast"]
    first = newest(received[:1], "timer_fast")
    assert first is not None
    assert first.standing == "kept"  # the first second is ignored
    assert rate is not None
    assert rate.expected_hz == 1000
    # It sleeps for five periods: one tick in five or fewer, the next at least four late.
    assert rate.measured_hz < 205
    assert rate.overruns >= 3.9 * rate.ticks
    assert rate.late_p50_us >= 3_900


def test_coroutines_of_the_configs_timers_are_counted() -> None:
    with listening(Awaiting, EventLoopExecutor) as (_, received):
        eventually(lambda: (newest(received, "timer_slow") or NONE).ticks >= 3, "three ticks")
        assert (newest(received, "timer_fast") or NONE).ticks >= 3
        assert (newest(received, "timer_slow") or NONE).expected_hz == 2


def is_received_for(received: list[RatesReported], wait_s: float) -> bool:
    """Whether more reports arrive within a time."""
    before = len(received)
    time.sleep(wait_s)
    return len(received) > before


@pytest.mark.slow
def test_only_an_active_node_reports_of_its_rates() -> None:
    with listening(Two, EventLoopExecutor) as (node, received):
        eventually(lambda: len(received) >= 2, "reports")
        assert request(node, "deactivate")
        # A report in progress may still arrive.
        eventually(lambda: not is_received_for(received, 1.5), "silence")
        before = len(received)
        assert request(node, "cleanup")
        assert request(node, "configure")
        assert request(node, "activate")
        eventually(lambda: len(received) > before, "reports again")
        assert [rate.name for rate in received[before].rates] == ["timer_slow", "timer_fast"]


@pytest.mark.slow
def test_on_simulated_time_rates_use_it_and_none_is_expected_while_it_is_paused() -> None:
    """Simulated time runs at a fifth of wall time: 10 Hz of it are 2 Hz."""

    def make() -> ObeliskNode:
        slow = "{timer_period_sec: 0.1}"
        return Awaiting(use_sim_time=True, timer_slow_setting=slow, timer_fast_setting=slow)

    with listening(make, EventLoopExecutor) as (node, received):
        clock = node.create_publisher(Clock, "/clock", 10)
        now_ms = 1000

        def move_on() -> bool:
            nonlocal now_ms
            now_ms += 4
            clock.publish(Clock(clock=Time(sec=now_ms // 1000, nanosec=now_ms % 1000 * 10**6)))
            return (newest(received, "timer_slow") or NONE).ticks >= 8

        eventually(move_on, "eight ticks", seen=lambda: str(received))
        assert (newest(received, "timer_slow") or NONE).measured_hz > 4
        stopped = len(received)
        eventually(lambda: len(received) >= stopped + 3, "reports")
        assert (newest(received, "timer_slow") or NONE).standing == "kept"


def test_a_node_is_silenced_by_its_parameter() -> None:
    def make() -> ObeliskNode:
        return Two(report_rates=False)

    with listening(make, EventLoopExecutor) as (node, _):
        assert node.count_publishers(DIAGNOSTICS_TOPIC) == 0


def test_a_status_has_its_node_and_its_fault() -> None:
    from diagnostic_msgs.msg import DiagnosticArray

    with listening(Two, EventLoopExecutor) as (node, _):
        arrays: list[Any] = []
        node.create_subscription(DiagnosticArray, DIAGNOSTICS_TOPIC, arrays.append, 10)
        eventually(lambda: arrays and arrays[-1].status[1].level == b"\x02", "an error")
        status = arrays[-1].status[1]
        assert (status.name, status.hardware_id) == ("arm/two: timer_fast", "/arm/two")
        assert status.message.startswith("broken: ")
        assert status.message.endswith(" of 1000 Hz")
        assert arrays[-1].header.stamp.sec > 0
        assert rates_of(arrays[-1]) is not None


DAWDLE = (
    "compute_control(self):\n        import time\n\n        time.sleep(0.005)\n\n    def unused"
)
FAST, SLOW = "timer_period_sec: 0.001", "timer_period_sec: 0.5"


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The dummy with a 1 kHz controller whose callback takes 5 ms; the other nodes expect no rates.

    Their rates are such that a loaded machine does not keep them either.
    """
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))
    config = with_faulty_controller(tmp_path, DAWDLE, "pass", EXAMPLE)
    text = config.read_text()
    for once in ("jointencoders_passthrough_estimator\n", "obelisk_mujoco_robot\n      params:\n"):
        assert text.count(once) == 1
    text = text.replace("passthrough_estimator\n", f"passthrough_estimator\n      params:\n{MUTE}")
    text = text.replace("mujoco_robot\n      params:\n", f"mujoco_robot\n      params:\n{MUTE}")
    config.write_text(text)
    return config


MUTE = "        report_rates: False\n"


@pytest.mark.mujoco
def test_strict_rates_end_a_stack_with_a_throttled_node_and_name_it(config: Path) -> None:
    result = obk("launch", config, "--strict-rates", "--quiet", "--duration", 60)
    assert result.returncode == 1, result.stdout
    (failed,) = [line for line in result.stdout.splitlines() if line.startswith("failed: ")]
    assert "/obelisk_control_0: timer_ctrl runs at " in failed
    assert " of 1000 Hz (p99 latency " in failed
    lines = config.read_text().splitlines()
    number = next(n for n, line in enumerate(lines, start=1) if FAST in line)
    assert f"set at {config}:{number}:" in failed
    assert "control_0: deactivate ok" in result.stdout
    assert not marked()


@pytest.mark.mujoco
@pytest.mark.parametrize("how", [(), pytest.param(("--composed",), marks=pytest.mark.slow)])
def test_a_throttled_node_is_reported_once_and_shown_by_ps(
    config: Path, how: tuple[str, ...]
) -> None:
    with launched(config, "--quiet", *how) as run:
        run.wait_for_line("control_0: RATE: timer_ctrl runs at ")
        rates = rates_reported_of("control")
        assert [(rate["name"], rate["standing"]) for rate in rates["control"]] == [
            ("timer_ctrl", "broken")
        ]
        assert rates["estimation"] == rates["robot"] == []
        eventually(lambda: "timer_ctrl runs at " in obk("ps").stdout, "the rate in words")
    assert run.process.returncode == 0
    # A process that a busy machine delays may also be reported as silent.
    assert run.text.count("RATE: timer_ctrl runs at ") == 1


@pytest.mark.mujoco
def test_a_stack_that_keeps_its_rates_continues_with_strict_rates(config: Path) -> None:
    config.write_text(config.read_text().replace(FAST, SLOW))
    options = ("--strict-rates", "--quiet", "--duration", 5, "--format", "json")
    result = obk("launch", config, *options)
    assert result.returncode == 0, result.stdout
    events = [json.loads(line) for line in result.stdout.splitlines() if line.startswith("{")]
    assert not [event for event in events if event["event"] in ("RateBroken", "RateKept")]
    assert (events[-1]["event"], events[-1]["cause"]) == ("Ended", "")


@pytest.mark.slow
@pytest.mark.mujoco
def test_a_simulator_expects_rates_of_its_steps_and_its_sensors(config: Path) -> None:
    config.write_text(config.read_text().replace(MUTE, "", 2))
    with launched(config, "--quiet"):
        rates = rates_reported_of("robot")["robot"]
        assert [rate["name"] for rate in rates] == [
            "/obelisk/dummy/joint_encoders",
            "/obelisk/dummy/obk_joint_encoders",
            "/obelisk/dummy/imu",
            "/obelisk/dummy/framepose",
            "steps",
        ]
        wanted = [rate["expected_hz"] for rate in rates]
        assert wanted == [1000, 1000, 500, 500, 1000]
        # In simulation time, which load does not change; a delayed node counts as silent.
        eventually(
            lambda: (
                {rate["standing"] for rate in rates_reported_of("robot")["robot"][:-1]} == {"kept"}
            ),
            "kept rates",
        )


def rates_reported_of(section: str) -> dict[str, list[dict[str, Any]]]:
    """The rates that `obk ps` shows for each section's node, once it shows any for this section.

    It repeats the request if a busy machine delays the launcher's reply too long.
    """
    reported: dict[str, list[dict[str, Any]]] = {}

    def is_reported() -> bool:
        (stack,) = json.loads(obk("ps", "--format", "json").stdout)["stacks"]
        reported.update({node["section"]: node["rates"] for node in stack["nodes"]})
        return bool(reported.get(section))

    eventually(is_reported, f"rates of {section}")
    return reported
