"""One sensor group as outputs: sampled, disturbed, published.

In: a group, its sampler, what publishes. Out: an output of samples and, where messages are delayed,
one that releases them. A group without disturbances pays nothing for them, and is not sampled while
nobody listens; a disturbed one is, so that its random numbers do not depend on who listens.
"""

from collections.abc import Callable, Iterator
from typing import Any

from obelisk_py.core.sim.mujoco.block import SensorGroup
from obelisk_py.core.sim.mujoco.disturbances import Chance, DelayLine, Dropout, Noise
from obelisk_py.core.sim.mujoco.sensors import Sampler
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.stepper import Output
from obelisk_py.core.sim.mujoco.stepping import SampleTimes

__all__ = ["group_outputs", "if_heard", "sampled"]

Publish = Callable[[Any], None]
Sample = Callable[[int], None]
"""Takes a sample and sends it, with a stamp [ns]."""


def group_outputs(
    simulation: Simulation,
    group: SensorGroup,
    sampler: Sampler,
    publish: Publish,
    *,
    is_heard: Callable[[], bool],
    left_out: Callable[[], None],
) -> Iterator[Output]:
    """The outputs of a group.

    Args:
        simulation: what is sampled.
        group: the settings.
        sampler: takes the samples.
        publish: sends a message.
        is_heard: whether anybody listens.
        left_out: called for each sample that is lost to dropout, or that nobody would hear.
    """
    times = SampleTimes(period_s=group.period_s, step_s=simulation.step_s)
    settings = group.disturbances
    line = None
    if settings.delay_s > 0.0:
        line = DelayLine(delay_s=settings.delay_s, step_s=simulation.step_s)
        yield Output(times=line, publish=_release(line, publish), restart=line.restart)
    send = publish if line is None else _hold(line, simulation)
    if not settings.noise and settings.dropout == 0.0:
        sample = sampled(sampler, send)
        yield Output(times=times, publish=if_heard(is_heard, sample, left_out))
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
            left_out()
        else:
            disturbed(stamp_ns)

    def restart() -> None:
        dropout.restart()
        if noise is not None:
            noise.restart()

    yield Output(times=times, publish=publish_unless_lost, restart=restart)


def sampled(sampler: Sampler, send: Publish) -> Sample:
    """Takes samples and sends them at once, but for those that come later."""
    take, message = sampler.take, sampler.message
    if message is None:
        return lambda _stamp_ns: take()

    def publish(stamp_ns: int) -> None:
        take()
        send(message.to_bytes(stamp_ns))

    return publish


def if_heard(is_heard: Callable[[], bool], sample: Sample, left_out: Callable[[], None]) -> Sample:
    """Takes samples while somebody listens; else calls `left_out`."""

    def publish(stamp_ns: int) -> None:
        if is_heard():
            sample(stamp_ns)
        else:
            left_out()

    return publish


def _hold(line: DelayLine, simulation: Simulation) -> Publish:
    return lambda message: line.hold(message, simulation.steps)


def _release(line: DelayLine, publish: Publish) -> Sample:
    return lambda _stamp_ns: publish(line.release())
