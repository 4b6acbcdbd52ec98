"""One sensor group as outputs: sampled, disturbed, published.

In: a group, its sampler, what publishes. Out: an output of samples and, where messages are delayed,
one that releases them. A group without disturbances pays nothing for them.
"""

from collections.abc import Callable, Iterator
from typing import Any

from obelisk_py.core.sim.mujoco.block import SensorGroup
from obelisk_py.core.sim.mujoco.disturbances import Chance, DelayLine, Dropout, Noise
from obelisk_py.core.sim.mujoco.sensors import Sampler
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.stepper import Output
from obelisk_py.core.sim.mujoco.stepping import SampleTimes

__all__ = ["group_outputs", "sampled"]

Publish = Callable[[Any], None]


def group_outputs(
    simulation: Simulation,
    group: SensorGroup,
    sampler: Sampler,
    publish: Publish,
    *,
    dropped: Callable[[], None],
) -> Iterator[Output]:
    """The outputs of a group; `dropped` is called for each message that its dropout takes."""
    times = SampleTimes(period_s=group.period_s, step_s=simulation.step_s)
    settings = group.disturbances
    line = None
    if settings.delay_s > 0.0:
        line = DelayLine(delay_s=settings.delay_s, step_s=simulation.step_s)
        yield Output(times=line, publish=_release(line, publish), restart=line.restart)
    send = publish if line is None else _hold(line, simulation)
    if not settings.noise and settings.dropout == 0.0:
        yield Output(times=times, publish=sampled(sampler, send))
        return
    chance = Chance(seed=settings.seed, topic=group.topic, purpose="dropout")
    dropout = Dropout(settings.dropout, chance)
    noise = None
    if sampler.message is not None:
        noise = Noise(group.msg_type, settings, group.topic, sampler.message)

    def take() -> None:
        sampler.take()
        if noise is not None:
            noise.add()

    disturbed = sampled(Sampler(message=sampler.message, take=take), send)

    def publish_unless_lost(stamp_ns: int) -> None:
        if dropout.strikes():
            dropped()
        else:
            disturbed(stamp_ns)

    def restart() -> None:
        dropout.restart()
        if noise is not None:
            noise.restart()

    yield Output(times=times, publish=publish_unless_lost, restart=restart)


def sampled(sampler: Sampler, send: Publish) -> Callable[[int], None]:
    """Takes a sample and sends it with the stamp [ns] that it is called with."""
    take, message = sampler.take, sampler.message
    if message is None:
        return lambda _stamp_ns: take()

    def publish(stamp_ns: int) -> None:
        take()
        send(message.to_bytes(stamp_ns))

    return publish


def _hold(line: DelayLine, simulation: Simulation) -> Publish:
    return lambda message: line.hold(message, simulation.steps)


def _release(line: DelayLine, publish: Publish) -> Callable[[int], None]:
    return lambda _stamp_ns: publish(line.release())
