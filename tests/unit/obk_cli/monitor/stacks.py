"""Fake stacks for the tests of displays."""

from dataclasses import replace
from typing import Final

from obelisk_spec.runtime_protocol import Rate
from obk_cli.monitor.model import MessageAge, NodeView, ProcessLoad, StackView, TopicView
from obk_cli.ros.meters import TopicRate

__all__ = ["BROKEN", "COMPOSED", "ELSEWHERE", "HEALTHY", "node", "topic"]


def node(name: str, section: str, pid: int | None = 4711, state: str = "active") -> NodeView:
    return NodeView(
        node=name,
        section=section,
        state=state,
        pid=pid,
        shares_process=False,
        load=ProcessLoad(cpu_percent=12.34, memory_bytes=74_000_000, uptime_s=83.0)
        if pid
        else None,
        restarts=0,
        hangs=False,
        rates=(),
    )


def topic(
    name: str,
    kind: str,
    hz: float | None = 1000.0,
    *,
    age_s: float | None = None,
    made_from: tuple[str, ...] = (),
) -> TopicView:
    return TopicView(
        topic=f"/obelisk/dummy/{name}",
        msg_type=kind,
        publishers=1,
        subscriptions=1,
        expected_hz=1000.0,
        rate=TopicRate(
            count=5000,
            lost=0,
            seen=2000 if hz else 0,
            window_s=2.0 if hz else 0.0,
            rate_hz=hz,
            jitter_s=0.000123 if hz else None,
            bytes_per_s=56_000.0 if hz else None,
            age_s=0.0012 if hz else 4.2,
        ),
        age=(
            None
            if age_s is None
            else MessageAge(p50_s=age_s, p99_s=3 * age_s, is_carried=bool(made_from))
        ),
        made_from=tuple(f"/obelisk/dummy/{one}" for one in made_from),
    )


HEALTHY: Final = StackView(
    run="dummy_20310203_040506",
    name="dummy",
    domain=7,
    state="active",
    phase="active",
    uptime_s=83.4,
    realtime_factor=0.998,
    nodes=(
        node("/obelisk_control_0", "control", 4711),
        node("/obelisk_estimation_0", "estimation", 4712),
        node("/obelisk_robot_0", "robot", 4713),
    ),
    topics=(
        topic("joint_encoders", "obelisk_sensor_msgs/msg/JointEncoders", 999.96, age_s=0.0002),
        topic(
            "est",
            "obelisk_estimator_msgs/msg/EstimatedState",
            age_s=0.0006,
            made_from=("joint_encoders",),
        ),
        topic(
            "ctrl", "obelisk_control_msgs/msg/PositionSetpoint", age_s=0.0011, made_from=("est",)
        ),
    ),
    lines=(
        "[  2.84 s] active",
        "robot_0      | [WARN] [1795292240.7] [obelisk_robot_0]: the simulation fell behind",
        "control_0    | \x1b[31mred\x1b[0m [ERROR] [1795292240.7] [obelisk_control_0]: no goal yet",
    ),
    cost_percent=3.21,
)
"""Stamps are copied from the encoders to the controls."""

BROKEN: Final = replace(
    HEALTHY,
    state="inactive",
    nodes=(
        replace(
            HEALTHY.nodes[0],
            rates=(
                Rate(
                    name="timer_ctrl",
                    expected_hz=1000.0,
                    measured_hz=463.4,
                    ticks=9,
                    overruns=5,
                    late_p50_us=1.0,
                    late_p99_us=2.0,
                    late_max_us=3.0,
                    standing="broken",
                ),
            ),
            hangs=True,
            restarts=2,
        ),
        replace(HEALTHY.nodes[1], state="inactive"),
        replace(HEALTHY.nodes[2], pid=None, load=None, state="finalized"),
    ),
    topics=(
        topic("joint_encoders", "obelisk_sensor_msgs/msg/JointEncoders", 880.0),
        topic("est", "obelisk_estimator_msgs/msg/EstimatedState", None),
        replace(
            topic("ctrl", "obelisk_control_msgs/msg/PositionSetpoint", None),
            rate=None,
            is_expected=False,
        ),
    ),
)
"""One node hangs, one has ended, one topic is slow and one is silent."""

COMPOSED: Final = replace(
    HEALTHY, nodes=tuple(replace(one, pid=4711, shares_process=True) for one in HEALTHY.nodes)
)
"""All nodes in one process."""

ELSEWHERE: Final = StackView(
    run="",
    name="",
    domain=0,
    state="",
    phase="",
    uptime_s=0.0,
    realtime_factor=None,
    nodes=(node("/obelisk_robot_0", "robot", None),),
    topics=(replace(HEALTHY.topics[0], expected_hz=None, topic="/imu"),),
    lines=(),
    cost_percent=1.0,
)
"""Launched on another host; nothing is simulated."""
