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

__all__ = ["group_outputs"]

Publish = Callable[[Any], None]


def group_outputs(
    simulation: Simulation,
    group: SensorGroup,
    sample: Sampler,
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
        yield Output(times=times, publish=_sampled(sample, send))
        return
    noise = Noise(group.msg_type, settings, group.topic)
    chance = Chance(seed=settings.seed, topic=group.topic, purpose="dropout")
    dropout = Dropout(settings.dropout, chance)

    def disturbed(stamp: Any) -> Any:
        if dropout.strikes():
            dropped()
            return None
        message = sample(stamp)
        if message is not None:
            noise.add(message)
        return message

    def restart() -> None:
        dropout.restart()
        noise.restart()

    yield Output(times=times, publish=_sampled(disturbed, send), restart=restart)


def _sampled(sample: Sampler, send: Publish) -> Publish:
    def publish(stamp: Any) -> None:
        message = sample(stamp)
        if message is not None:
            send(message)

    return publish


def _hold(line: DelayLine, simulation: Simulation) -> Publish:
    return lambda message: line.hold(message, simulation.steps)


def _release(line: DelayLine, publish: Publish) -> Publish:
    return lambda _stamp: publish(line.release())
