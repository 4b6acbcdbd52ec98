"""What a simulation publishes: from the `sim` block to outputs of the stepping thread.

In: a simulation, its block, a way to make publishers. Out: one output per sensor group, one for the
markers of geoms.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final, Protocol

from visualization_msgs.msg import MarkerArray

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.audience import Audience
from obelisk_py.core.sim.mujoco.block import SensorGroup, SimBlock
from obelisk_py.core.sim.mujoco.geoms import marker_sampler
from obelisk_py.core.sim.mujoco.groups import group_outputs, if_heard, sampled
from obelisk_py.core.sim.mujoco.sensors import SENSOR_KINDS, Sampler, SensorSource
from obelisk_py.core.sim.mujoco.sensors.fields import in_turn
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.stepper import Output
from obelisk_py.core.sim.mujoco.stepping import SampleTimes

__all__ = ["GEOM_TOPICS", "Environment", "MakePublisher", "outputs_of", "promise_nothing"]

GEOM_TOPICS: Final = ("~/viz_geoms", "obelisk/sim/mujoco_scene_viz")
"""Topics of the markers; the second is where a visualiser looks without knowing the node."""
GEOM_DEPTH: Final = 10


class Publisher(Protocol):
    """Sends messages."""

    def publish(self, message: Any) -> None:
        """Send a message, or the bytes of a packed one."""

    def get_subscription_count(self) -> int:
        """How many listen."""


MakePublisher = Callable[[type[Any], str, int], Publisher]
"""Message type, topic, history depth -> publisher."""


Promise = Callable[[str, float], Callable[[], None]]
"""Topic, simulation time between two samples [s] -> what is to be called at each sample."""


def promise_nothing(_topic: str, _period_s: float) -> Callable[[], None]:
    """Nobody counts."""
    return lambda: None


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """What outputs need of the node that has the simulation."""

    make_publisher: MakePublisher
    """Called once per topic."""
    warn: Callable[[str], None]
    """Takes sentences about groups that say something odd; on any thread."""
    on_close: Callable[[Callable[[], None]], object]
    """Takes what has to be called when the simulation is freed."""
    is_paced: bool
    """Whether steps are due at times."""
    promise: Promise = promise_nothing
    """Called once per sensor group."""


def outputs_of(
    simulation: Simulation, block: SimBlock, surroundings: Environment
) -> tuple[Output, ...]:
    """The outputs that a block asks for.

    Raises:
        ObeliskConfigError: with all groups that this machine cannot sample.
    """
    outputs: list[Output] = []
    errors = []
    for group in block.groups:
        try:
            outputs += _group(simulation, group, surroundings)
        except ObeliskConfigError as error:
            errors.append(f"{group.topic}: {error}")
    if errors:
        raise ObeliskConfigError("the sim block cannot be simulated:\n" + "\n".join(errors))
    if block.geoms:
        outputs.append(_geoms(simulation, block, surroundings.make_publisher))
    return tuple(outputs)


def _group(
    simulation: Simulation, group: SensorGroup, surroundings: Environment
) -> Iterator[Output]:
    kind = SENSOR_KINDS[group.msg_type]
    publisher = surroundings.make_publisher(kind.message_type, group.topic, group.history_depth)
    publish = publisher.publish
    count = surroundings.promise(group.topic, max(group.period_s, simulation.step_s))

    def deliver(message: Any) -> None:
        count()
        publish(message)

    sampler = kind.build(
        SensorSource(
            model=simulation.model,
            data=simulation.data,
            names=group.sensor_names,
            rays=group.rays,
            warn=surroundings.warn,
            deliver=deliver,
            on_close=surroundings.on_close,
            is_paced=surroundings.is_paced,
        )
    )

    if sampler.message is not None:
        sampler = Sampler(message=sampler.message, take=in_turn((sampler.take, count)))
    audience = Audience(publisher.get_subscription_count)
    return group_outputs(
        simulation, group, sampler, publish, is_heard=audience.is_there, left_out=count
    )


def _geoms(simulation: Simulation, block: SimBlock, make_publisher: MakePublisher) -> Output:
    sampler = marker_sampler(simulation.model, simulation.data, block.geoms)
    publishers = [make_publisher(MarkerArray, topic, GEOM_DEPTH) for topic in GEOM_TOPICS]
    audiences = [Audience(publisher.get_subscription_count) for publisher in publishers]

    def is_heard() -> bool:
        return any(audience.is_there() for audience in audiences)

    def send(markers: bytes) -> None:
        for publisher in publishers:
            publisher.publish(markers)

    return Output(
        times=SampleTimes(period_s=block.geoms_period_s, step_s=simulation.step_s),
        publish=if_heard(is_heard, sampled(sampler, send), lambda: None),
    )
