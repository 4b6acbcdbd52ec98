"""Create the outputs of the stepping thread from the `sim` block.

Each sensor group has one output, and a second one if its messages are delayed. All markers of
geoms share one output. Without a subscriber, no ray is cast, no image is rendered and nothing is
sent, except for groups with noise or dropout: their random numbers must not depend on who
subscribes. Groups without noise, dropout and delay have no extra cost.

`SimulationClock` outputs the simulated time. It writes the time to the launch's clock page after
each step, for the launch's Python nodes on this host. For all other nodes it publishes `/clock`, at
a limited rate and only while it has subscribers.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

from rosgraph_msgs.msg import Clock
from visualization_msgs.msg import MarkerArray

from obelisk_py.core.clock_page import ClockWriter
from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.messages import require_message
from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.geoms import marker_sampler
from obelisk_py.core.sim.mujoco.noise import DelayLine, Dropout, NoiseGenerator, RandomStream
from obelisk_py.core.sim.mujoco.sensors import SENSOR_KINDS, Sampler, SensorSource
from obelisk_py.core.sim.mujoco.sim_config import SensorGroupConfig, SimConfig
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.step_times import NS_PER_S, SampleTimes
from obelisk_py.core.sim.mujoco.stepper import TimedOutput
from obelisk_spec.runtime_protocol import CLOCK_TOPIC

__all__ = [
    "GEOM_TOPICS",
    "MakePublisher",
    "OutputContext",
    "SimulationClock",
    "SubscriberCheck",
    "group_outputs",
    "if_subscribed",
    "no_rate_monitor",
    "outputs_of",
    "sampled",
]

_CHECK_PERIOD_NS: Final = 5_000_000
"""Wall time for which a count stays valid [ns]; querying the middleware per sample is slow."""
Publish = Callable[[Any], None]
Sample = Callable[[int], None]
"""Takes a sample and sends it with a stamp [ns]."""
GEOM_TOPICS: Final = ("~/viz_geoms", "obelisk/sim/mujoco_scene_viz")
"""Topics of the markers; the second one does not depend on the name of the node."""
GEOM_DEPTH: Final = 10
CLOCK_DEPTH: Final = 10
"""For a reliable publisher, which matches reliable and best-effort subscriptions. Nodes request
best effort and depth 1 (`ClockQoS` of rclcpp)."""
MonitorRate = Callable[[str, float], Callable[[], None]]
"""Topic, simulated time between two samples [s] -> function to call per sample."""


class SubscriberCheck:
    """Checks every few milliseconds whether a publisher has subscribers."""

    def __init__(
        self, count: Callable[[], int], now_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        """Call `count` for the number of subscriptions, and `now_ns` for the time [ns]."""
        self._count = count
        self._now_ns = now_ns
        self._check_at_ns: float = -float("inf")
        self._has_subscribers = False

    def has_subscribers(self) -> bool:
        """Whether the topic has a subscriber; up to `_CHECK_PERIOD_NS` out of date."""
        now_ns = self._now_ns()
        if now_ns >= self._check_at_ns:
            self._check_at_ns = now_ns + _CHECK_PERIOD_NS
            self._has_subscribers = self._count() > 0
        return self._has_subscribers


def group_outputs(
    simulation: Simulation,
    group: SensorGroupConfig,
    sampler: Sampler,
    publish: Publish,
    *,
    has_subscribers: Callable[[], bool],
    count: Callable[[], None],
) -> Iterator[TimedOutput]:
    """Create the outputs of a group.

    Args:
        simulation: the simulation to sample.
        group: the settings.
        sampler: takes the samples.
        publish: sends a message.
        has_subscribers: returns whether the topic has a subscriber.
        count: called for each sample that is taken or dropped, or that has no subscriber. Not
            called for a taken sample that the sampler delivers later.
    """
    times = SampleTimes(period_s=group.period_s, step_s=simulation.step_s)
    settings = group.sensor_noise
    line = None
    if settings.delay_s > 0.0:
        line = DelayLine(delay_s=settings.delay_s, step_s=simulation.step_s)
        yield TimedOutput(times=line, publish=_release(line, publish), restart=line.restart)
    send = publish if line is None else _hold(line, simulation)
    if not settings.noise and settings.dropout == 0.0:
        sample = sampled(sampler, send, count)
        yield TimedOutput(times=times, publish=if_subscribed(has_subscribers, sample, count))
        return
    stream = RandomStream(seed=settings.seed, topic=group.topic, purpose="dropout")
    dropout = Dropout(settings.dropout, stream)
    noise = None
    if sampler.message is not None:
        noise = NoiseGenerator(group.msg_type, settings, group.topic, sampler.message)

    def take() -> None:
        sampler.take()
        if noise is not None:
            noise.add()

    disturbed = sampled(Sampler(message=sampler.message, take=take), send, count)

    def publish_unless_lost(stamp_ns: int) -> None:
        if dropout.is_dropped():
            count()
        else:
            disturbed(stamp_ns)

    def restart() -> None:
        dropout.restart()
        if noise is not None:
            noise.restart()

    yield TimedOutput(times=times, publish=publish_unless_lost, restart=restart)


def sampled(sampler: Sampler, send: Publish, count: Callable[[], None]) -> Sample:
    """Take, count and send samples; a sampler without a message sends its samples itself, later."""
    take, message = sampler.take, sampler.message
    if message is None:
        return lambda _stamp_ns: take()
    to_bytes = message.to_bytes

    def publish(stamp_ns: int) -> None:
        take()
        count()
        send(to_bytes(stamp_ns))

    return publish


def if_subscribed(
    has_subscribers: Callable[[], bool], sample: Sample, count: Callable[[], None]
) -> Sample:
    """Take samples while there is a subscriber, otherwise call `count`."""

    def publish(stamp_ns: int) -> None:
        if has_subscribers():
            sample(stamp_ns)
        else:
            count()

    return publish


def _hold(line: DelayLine, simulation: Simulation) -> Publish:
    return lambda message: line.hold(message, simulation.steps)


def _release(line: DelayLine, publish: Publish) -> Sample:
    return lambda _stamp_ns: publish(line.release())


class Publisher(Protocol):
    """Sends messages."""

    def publish(self, message: Any) -> None:
        """Send a message, or the bytes of a packed one."""

    def get_subscription_count(self) -> int:
        """Number of subscriptions."""


MakePublisher = Callable[[type[Any], str, int], Publisher]
"""Message type, topic, history depth -> publisher."""


def no_rate_monitor(_topic: str, _period_s: float) -> Callable[[], None]:
    """Monitor nothing."""
    return _count_nothing


def _count_nothing() -> None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputContext:
    """The parts of the simulation's node that outputs use."""

    make_publisher: MakePublisher
    """Called once per topic."""
    warn: Callable[[str], None]
    """Logs warnings about sensor groups; called on any thread."""
    on_close: Callable[[Callable[[], None]], object]
    """Registers functions to call when the simulation is closed."""
    is_paced: bool
    """Whether steps are due at given times."""
    is_lockstep: bool = False
    """Whether the simulation waits for each image, and counts subscribers for each sample."""
    noise_seed: int = 0
    """Changes the noise of all groups; 0 keeps the noise as configured."""
    monitor_rate: MonitorRate = no_rate_monitor
    """Called once per sensor group."""


def outputs_of(
    simulation: Simulation, config: SimConfig, context: OutputContext
) -> tuple[TimedOutput, ...]:
    """Create the outputs that the config defines.

    Raises:
        ObeliskConfigError: this machine cannot sample some groups; the message lists them all.
    """
    outputs: list[TimedOutput] = []
    errors = []
    for group in config.groups:
        try:
            outputs += _group(simulation, group, context)
        except ObeliskConfigError as error:
            errors.append(f"{group.topic}: {error}")
    if errors:
        raise ObeliskConfigError("the sim block cannot be simulated:\n" + "\n".join(errors))
    if config.geoms:
        outputs.append(_geoms(simulation, config, context))
    return tuple(outputs)


def _group(
    simulation: Simulation, group: SensorGroupConfig, context: OutputContext
) -> Iterator[TimedOutput]:
    if context.noise_seed:
        noise = group.sensor_noise
        group = replace(
            group, sensor_noise=replace(noise, seed=noise.seed + (context.noise_seed << 32))
        )
    kind = SENSOR_KINDS[group.msg_type]
    message_type = require_message(kind.message_type)
    publisher = context.make_publisher(message_type, group.topic, group.history_depth)
    publish = publisher.publish
    count = context.monitor_rate(group.topic, max(group.period_s, simulation.step_s))

    def deliver(message: Any) -> None:
        count()
        publish(message)

    sampler = kind.build(
        SensorSource(
            model=simulation.model,
            data=simulation.data,
            names=group.sensor_names,
            rays=group.rays,
            warn=context.warn,
            deliver=deliver,
            on_close=context.on_close,
            is_paced=context.is_paced,
            is_lockstep=context.is_lockstep,
        )
    )

    return group_outputs(
        simulation,
        group,
        sampler,
        publish,
        has_subscribers=_check_of(publisher, context),
        count=count,
    )


def _check_of(publisher: Publisher, context: OutputContext) -> Callable[[], bool]:
    """Return a function that checks whether a publisher's topic has subscribers."""
    count = publisher.get_subscription_count
    return (lambda: count() > 0) if context.is_lockstep else SubscriberCheck(count).has_subscribers


def _geoms(simulation: Simulation, config: SimConfig, context: OutputContext) -> TimedOutput:
    sampler = marker_sampler(simulation.model, simulation.data, config.geoms)
    publishers = [context.make_publisher(MarkerArray, topic, GEOM_DEPTH) for topic in GEOM_TOPICS]
    checks = [_check_of(publisher, context) for publisher in publishers]

    def has_subscribers() -> bool:
        return any(check() for check in checks)

    def send(markers: bytes) -> None:
        for publisher in publishers:
            publisher.publish(markers)

    return TimedOutput(
        times=SampleTimes(period_s=config.geoms_period_s, step_s=simulation.step_s),
        publish=if_subscribed(
            has_subscribers, sampled(sampler, send, _count_nothing), _count_nothing
        ),
    )


class SimulationClock:
    """The clock that other nodes follow; all methods must be called on the stepping thread."""

    def __init__(
        self,
        make_publisher: MakePublisher,
        *,
        page: ClockWriter | None,
        rate_hz: float,
        time_ns: Callable[[], int],
    ) -> None:
        """Create the publisher of `/clock`.

        Args:
            make_publisher: creates a publisher of the robot.
            page: the launch's clock page; None if it has none.
            rate_hz: maximum rate of messages [Hz of simulated time].
            time_ns: returns the simulated time [ns].
        """
        self._publisher = make_publisher(Clock, CLOCK_TOPIC, CLOCK_DEPTH)
        self._check = SubscriberCheck(self._publisher.get_subscription_count)
        self._message = PackedMessage(Clock())
        self._period_ns = NS_PER_S / rate_hz
        self._time_ns = time_ns
        self._page = page
        self._next_ns = 0
        """When the next message is due."""

    def advance(self) -> None:
        """Publish the time after a step."""
        now_ns = self._time_ns()
        if self._page is not None:
            self._page.advance(now_ns)
        if now_ns < self._next_ns:
            return
        self._next_ns = self._next_after(now_ns)
        if self._check.has_subscribers():
            self._publisher.publish(self._message.to_bytes(now_ns))

    def restart(self) -> None:
        """Publish the time of a reset, because the next step may be a long time off."""
        now_ns = self._time_ns()
        if self._page is not None:
            self._page.restart(now_ns)
        self._next_ns = self._next_after(now_ns)
        self._publisher.publish(self._message.to_bytes(now_ns))

    def _next_after(self, now_ns: int) -> int:
        return round((now_ns // self._period_ns + 1) * self._period_ns)
