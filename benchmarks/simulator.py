"""Measure the timing accuracy of the simulator, and its cost on top of MuJoCo.

    python -m benchmarks.simulator [--only PART...] [--hour-steps N] [--schedule-s S]
        [--realtime-s S] [--rounds N]

Four parts, on the model and the sensor groups of the dummy example, with real publishers:

- hour: an hour of simulation time, as fast as possible; samples and drift of the stamps.
- schedule: ten times as fast as the wall clock; drift of the schedule against the clock, without
  the time that the simulator skipped because the machine was too slow.
- realtime: at real time; real-time factor, lateness of the steps, and CPU time relative to the same
  work without pacing, and to a loop that only sleeps and calls `mj_step`.
- cost: of a step relative to a bare loop of `mj_step`, and of one message of 30 joints. Measured in
  CPU time of the stepping thread, which other load disturbs least; the variants alternate. The
  three groups are received in the same process, by a node of the same run, and by a foreign node.

It writes `benchmarks/results/simulator.json`; exit code 1 if a sample is missing or a stamp is
wrong.
"""

import argparse
import json
import math
import os
import platform
import statistics
import sys
import tempfile
import threading
import time
from array import array
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import rclpy
from obelisk_sensor_msgs.msg import ObkImu, ObkJointEncoders
from rclpy.serialization import deserialize_message

from benchmarks.stolen import StolenTime, warn_of_stolen_time
from benchmarks.subscriber import SOCKETS_VARIABLE, node_of_run, subscriber
from obelisk_py.core.executor import EventLoopExecutor
from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.control import ControlInbox
from obelisk_py.core.sim.mujoco.loading import load_model
from obelisk_py.core.sim.mujoco.outputs import OutputContext, outputs_of
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.step_times import NS_PER_S, MonotonicClock, Pace
from obelisk_py.core.sim.mujoco.stepper import Stepper
from obelisk_spec.components import format_setting
from obelisk_spec.yaml_core import load_yaml_core
from obk_cli.ros.domains import free_domain

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "simulator.json"
DUMMY = ROOT / "examples" / "dummy" / "dummy_new.yaml"
JOINTS = 30
STEP_NS = 1_000_000
SCHEDULE_FACTOR = 10
BARE_SHARE = 6
"""A bare loop runs for a sixth of the time."""
MATCH_S = 20.0
"""Time by which every topic must have a subscription [s]."""


class Counted:
    """A publisher that counts its messages and keeps the last one."""

    def __init__(self, publisher: Any, *, is_always_received: bool) -> None:
        self._publish = publisher.publish
        self.get_subscription_count = publisher.get_subscription_count
        if is_always_received:
            self.get_subscription_count = lambda: 1
        self.count = 0
        self.newest = b""

    def publish(self, data: bytes) -> None:
        """Count and publish."""
        self.count += 1
        self.newest = data
        self._publish(data)


class NotingClock(MonotonicClock):
    """A clock that records the start of a run, the lateness of each sleep, and the last wake-up."""

    def __init__(self) -> None:
        self.late_ns = array("q")
        self.start_ns = 0
        self.woke_ns = 0

    def now_ns(self) -> int:
        """Read the clock, and record the first time."""
        now_ns = super().now_ns()
        self.start_ns = self.start_ns or now_ns
        return now_ns

    def sleep_until_ns(self, deadline_ns: int, stopped: Callable[[], bool]) -> int:
        """Sleep, and record how late the sleep ended."""
        self.woke_ns = super().sleep_until_ns(deadline_ns, stopped)
        self.late_ns.append(self.woke_ns - deadline_ns)
        return self.woke_ns


class Rig:
    """The simulator of the dummy with the given sensor groups."""

    def __init__(
        self,
        node: GuardedLifecycleNode,
        block: Mapping[str, Any],
        prefix: str,
        *,
        is_always_received: bool = True,
    ) -> None:
        """Prefix all topics; sample them only if they have a subscription, unless forced."""
        loaded = load_model(
            format_setting(dict(block)),
            keyframe="ic",
            folder=DUMMY.parent,
            share_of=lambda _: None,
            warn=print,
        )
        inbox = ControlInbox(field="u", size=loaded.model.nu, monotonic_s=time.monotonic)
        self.simulation = Simulation(loaded.model, inbox)
        self.simulation.reset(loaded.keyframe)
        self.publishers: dict[str, Counted] = {}
        self.periods_s = {group.topic: group.period_s for group in loaded.config.groups}

        def make_publisher(message: type[Any], topic: str, depth: int) -> Counted:
            publisher = node.create_lifecycle_publisher(
                message, prefix + topic.replace("~", ""), depth
            )
            publisher.on_activate(None)
            counted = Counted(publisher, is_always_received=is_always_received)
            return self.publishers.setdefault(topic, counted)

        self._outputs = outputs_of(
            self.simulation,
            loaded.config,
            OutputContext(
                make_publisher=make_publisher,
                warn=print,
                on_close=lambda _: None,
                is_paced=False,
            ),
        )

    def wait_for_subscribers(self) -> None:
        """Wait for a subscription on each topic."""
        end_s = time.monotonic() + MATCH_S
        while not all(each.get_subscription_count() for each in self.publishers.values()):
            if time.monotonic() > end_s:
                raise TimeoutError(f"no node subscribed to every topic within {MATCH_S:g} s")
            time.sleep(0.01)

    def run(self, steps: int, pace: Pace | None = None, longest_s: float = math.inf) -> NotingClock:
        """Run some steps, but stop after `longest_s` of wall time."""
        clock = NotingClock()
        simulation = self.simulation
        last = simulation.steps + steps
        end_s = time.monotonic() + longest_s
        Stepper(
            simulation,
            pace=pace,
            clock=clock,
            outputs=self._outputs,
            stamp=lambda: simulation.time_ns,
            warn=print,
            report=lambda _: None,
        ).run(lambda: simulation.steps >= last or time.monotonic() > end_s)
        return clock


def dummy_block() -> dict[str, Any]:
    """The `sim` block of the dummy example."""
    config: Any = load_yaml_core(DUMMY.read_text(encoding="utf-8"))
    block: dict[str, Any] = config["robot"]["sim"]
    return block


def three_groups() -> dict[str, Any]:
    """A `sim` block with encoders, IMU and pose after each step, without markers."""
    groups = [{**group, "dt": 0.001} for group in dummy_block()["sensor_settings"][1:]]
    return {**_bare_block(), "sensor_settings": groups}


def _bare_block() -> dict[str, Any]:
    return {"model_xml_path": dummy_block()["model_xml_path"]}


def hour(node: GuardedLifecycleNode, steps: int) -> dict[str, Any]:
    """The `hour` part: missing samples and drift in an hour of simulation time."""
    rig = Rig(node, dummy_block(), "/hour")
    start_s = time.monotonic()
    rig.run(steps)
    took_s = time.monotonic() - start_s
    sent = {topic: rig.publishers[topic].count for topic in rig.periods_s}
    wanted = {
        topic: steps // round(period_s * NS_PER_S / STEP_NS)
        for topic, period_s in rig.periods_s.items()
    }
    stamp = deserialize_message(rig.publishers["/obelisk/dummy/imu"].newest, ObkImu).header.stamp
    last_ns = stamp.sec * NS_PER_S + stamp.nanosec
    return {
        "steps": steps,
        "samples": sent,
        "missing": {topic: wanted[topic] - sent[topic] for topic in sent},
        "last_stamp_ns": last_ns,
        "drift_ns": last_ns - steps * STEP_NS,
        "drift_of_mujocos_own_time_ns": rig.simulation.data.time * NS_PER_S - steps * STEP_NS,
        "realtime_factor": steps * STEP_NS / NS_PER_S / took_s,
    }


def schedule(node: GuardedLifecycleNode, seconds: float) -> dict[str, Any]:
    """The `schedule` part: ten steps per millisecond of wall time."""
    rig = Rig(node, dummy_block(), "/schedule")
    pace = Pace(rig.simulation.step_s / SCHEDULE_FACTOR)
    steps = round(seconds * SCHEDULE_FACTOR * NS_PER_S / STEP_NS)
    clock = rig.run(steps, pace, seconds)
    # The lateness of the last step is not a drift of the schedule.
    due_ns = clock.woke_ns - clock.late_ns[-1]
    behind_s = (
        due_ns - clock.start_ns - len(clock.late_ns) * STEP_NS // SCHEDULE_FACTOR
    ) / NS_PER_S
    return {
        "seconds": seconds,
        "simulated_s": rig.simulation.time_ns / NS_PER_S,
        "overruns": pace.overruns,
        "given_up_s": pace.lost_s,
        "drift_us": (behind_s - pace.lost_s) * 1e6,
        "late_us": _late_us(clock),
    }


def realtime(node: GuardedLifecycleNode, seconds: float) -> dict[str, Any]:
    """The `realtime` part: paced steps, and the same steps without pacing."""
    steps = round(seconds * NS_PER_S / STEP_NS)
    paced, free = Rig(node, dummy_block(), "/paced"), Rig(node, dummy_block(), "/free")
    pace = Pace(paced.simulation.step_s)
    before_s, start_ns = time.process_time(), time.monotonic_ns()
    clock = paced.run(steps, pace)
    took_ns, used_s = time.monotonic_ns() - start_ns, time.process_time() - before_s
    before_s = time.process_time()
    free.run(steps)
    alone_s = time.process_time() - before_s
    bare_s, bare_alone_s = bare_loop(free.simulation, steps // BARE_SHARE)
    asleep_s = paced_s(lambda: None, steps // BARE_SHARE) * BARE_SHARE
    return {
        "seconds": seconds,
        "realtime_factor": steps * STEP_NS / took_ns,
        "overruns": pace.overruns,
        "late_us": _late_us(clock),
        "cpu_share": used_s / (took_ns / NS_PER_S),
        "cpu_of_the_work_alone_share": alone_s / (took_ns / NS_PER_S),
        "cpu_over_the_work_alone": used_s / alone_s,
        "cpu_beyond_sleeping_over_the_work_alone": (used_s - asleep_s) / alone_s,
        "sleeping_over_the_work_alone": asleep_s / alone_s,
        "cpu_of_a_bare_loop_share": bare_s / (took_ns / NS_PER_S) * BARE_SHARE,
        "cpu_over_a_bare_loop": used_s / BARE_SHARE / bare_s,
        "bare_loop_over_its_steps_alone": bare_s / bare_alone_s,
    }


def bare_loop(simulation: Simulation, steps: int) -> tuple[float, float]:
    """CPU time of `mj_step` called at real time, and of the same calls without pacing [s]."""
    model, data = simulation.model, simulation.data
    at_real_time_s = paced_s(lambda: mujoco.mj_step(model, data), steps)
    start_s = time.process_time()
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return at_real_time_s, time.process_time() - start_s


def paced_s(call: Callable[[], None], steps: int) -> float:
    """CPU time of a loop that only sleeps until each step is due and then makes a call [s]."""
    due_ns, start_s = time.monotonic_ns(), time.process_time()
    for _ in range(steps):
        due_ns += STEP_NS
        if (left_ns := due_ns - time.monotonic_ns()) > 0:
            time.sleep(left_ns / NS_PER_S)
        call()
    return time.process_time() - start_s


def _late_us(clock: NotingClock) -> dict[str, float]:
    late = sorted(clock.late_ns)
    found = {f"p{share}": late[len(late) * share // 100] / 1e3 for share in (50, 99)}
    return {**found, "max": late[-1] / 1e3}


@contextmanager
def subscribed_here(prefix: str) -> Iterator[None]:
    """Run a node that subscribes below a prefix, in this process on the library's executor."""
    node, executor = node_of_run(prefix), EventLoopExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    try:
        yield
    finally:
        executor.shutdown()
        thread.join()
        node.destroy_node()


def cost(node: GuardedLifecycleNode, rounds: int, steps: int) -> dict[str, Any]:
    """The `cost` part: median CPU time of a step and of a message; the variants alternate."""
    bare, silent = Rig(node, _bare_block(), "/bare"), Rig(node, _bare_block(), "/silent")
    sent = Rig(node, three_groups(), "/sent")
    rigs = {
        name: Rig(node, three_groups(), f"/{name}", is_always_received=False)
        for name in ("unheard", *SUBSCRIBERS)
    }
    messages = {
        "unheard": _encoders(node, "/unheard/encoders"),
        "heard": _encoders(node, f"/{BY_FOREIGN_NODE}/encoders"),
    }
    model, data = bare.simulation.model, bare.simulation.data

    def step_bare() -> None:
        for _ in range(steps):
            mujoco.mj_step(model, data)

    parts: dict[str, Callable[[], object]] = {
        "mj_step_us": step_bare,
        "no_sensors_us": lambda: silent.run(steps),
        "three_groups_sent_to_nobody_us": lambda: sent.run(steps),
        **{f"three_groups_{name}_us": partial(rig.run, steps) for name, rig in rigs.items()},
        **{
            f"encoders_of_{JOINTS}_joints_{name}_us": partial(publish, steps)
            for name, publish in messages.items()
        },
    }
    times: dict[str, list[float]] = {name: [] for name in parts}
    with ExitStack() as running:
        for name, subscribed in SUBSCRIBERS.items():
            running.enter_context(subscribed(f"/{name}"))
        for name in SUBSCRIBERS:
            rigs[name].wait_for_subscribers()
        for _ in range(rounds):
            for name, part in parts.items():
                before_ns = time.thread_time_ns()
                part()
                times[name].append((time.thread_time_ns() - before_ns) / steps / 1e3)
    medians = {name: statistics.median(each) for name, each in times.items()}
    over = ("no_sensors", *(f"three_groups_{name}" for name in rigs))
    return {
        "rounds": rounds,
        "steps": steps,
        **{name: _figures(each) for name, each in times.items()},
        **{f"{name}_over_mj_step": medians[f"{name}_us"] / medians["mj_step_us"] for name in over},
    }


BY_FOREIGN_NODE = "heard_by_foreign_node"
SUBSCRIBERS: Mapping[str, Callable[[str], Any]] = {
    "heard_in_process": subscribed_here,
    "heard_in_run": lambda prefix: subscriber(prefix, is_of_run=True),
    BY_FOREIGN_NODE: subscriber,
}
"""Key in the results -> a context in which a node subscribes below a prefix."""


def _encoders(node: GuardedLifecycleNode, topic: str) -> Callable[[int], None]:
    """A function that publishes a number of messages of 30 joints."""
    message = ObkJointEncoders(
        joint_names=[f"joint_{number}" for number in range(JOINTS)],
        joint_pos=[0.0] * JOINTS,
        joint_vel=[0.0] * JOINTS,
    )
    packed = PackedMessage(message)
    positions, velocities = packed.numbers("joint_pos"), packed.numbers("joint_vel")
    source = positions + 1.0
    publisher = node.create_lifecycle_publisher(ObkJointEncoders, topic, 10)
    publisher.on_activate(None)

    def publish(count: int) -> None:
        for number in range(count):
            positions[:] = source
            velocities[:] = source
            publisher.publish(packed.to_bytes(number))

    return publish


def _figures(values: list[float]) -> dict[str, float]:
    return {"median": statistics.median(values), "min": min(values), "max": max(values)}


def rounded(value: Any) -> Any:
    """Round all numbers to six significant digits."""
    if isinstance(value, dict):
        return {name: rounded(inner) for name, inner in value.items()}
    if isinstance(value, float) and math.isfinite(value):
        return float(f"{value:.6g}")
    return value


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Measure the requested parts, and keep the existing results of the others."""
    node = GuardedLifecycleNode("simulator_benchmark")
    parts: dict[str, Callable[[], dict[str, Any]]] = {
        "cost": lambda: cost(node, options.rounds, options.steps),
        "realtime": lambda: realtime(node, options.realtime_s),
        "hour": lambda: hour(node, options.hour_steps),
        "schedule": lambda: schedule(node, options.schedule_s),
    }
    # Parts that were measured before are kept.
    result = json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.exists() else {}
    result["machine"] = f"{platform.machine()}, {os.cpu_count()} processors"
    for name, part in parts.items():
        if not options.only or name in options.only:
            load, stolen = os.getloadavg()[0], StolenTime()
            found = {**part(), "stolen_percent": stolen.percent()}
            warn_of_stolen_time(found["stolen_percent"])
            result[name] = rounded({**found, "load_average": [load, os.getloadavg()[0]]})
    return result


def main() -> int:
    """Measure, print and write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hour-steps", type=int, default=3_600_000)
    parser.add_argument("--schedule-s", type=float, default=360.0)
    parser.add_argument("--realtime-s", type=float, default=60.0)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--steps", type=int, default=5_000, help="steps per round")
    parser.add_argument("--only", nargs="+", choices=["hour", "schedule", "realtime", "cost"])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="obk-simulator-") as sockets, free_domain() as domain:
        os.environ |= {
            SOCKETS_VARIABLE: sockets,  # has mode 0700, like the folder of a run
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        rclpy.init()
        result = measure(options)
        rclpy.shutdown()
    text = json.dumps(result, indent=1)
    RESULT.write_text(text + "\n", encoding="utf-8")
    print(text)
    if options.only and "hour" not in options.only:
        return 0
    return 1 if any(result["hour"]["missing"].values()) or result["hour"]["drift_ns"] else 0


if __name__ == "__main__":
    sys.exit(main())
