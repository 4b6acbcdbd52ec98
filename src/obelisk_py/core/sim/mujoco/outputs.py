"""What a simulation publishes: from the `sim` block to outputs of the stepping thread.

In: a simulation, its block, a way to make publishers. Out: one output per sensor group, one for the
markers of geoms.
"""

from collections.abc import Callable
from typing import Any, Final, Protocol

from visualization_msgs.msg import MarkerArray

from obelisk_py.core.sim.mujoco.block import SensorGroup, SimBlock
from obelisk_py.core.sim.mujoco.geoms import marker_sampler
from obelisk_py.core.sim.mujoco.sensors import SENSOR_KINDS, SensorSource
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.stepper import Output
from obelisk_py.core.sim.mujoco.stepping import SampleTimes

__all__ = ["GEOM_TOPICS", "MakePublisher", "outputs_of"]

GEOM_TOPICS: Final = ("~/viz_geoms", "obelisk/sim/mujoco_scene_viz")
"""Topics of the markers; the second is where a visualiser looks without knowing the node."""
GEOM_DEPTH: Final = 10


class Publisher(Protocol):
    """Sends messages."""

    def publish(self, message: Any) -> None:
        """Send a message."""


MakePublisher = Callable[[type[Any], str, int], Publisher]
"""Message type, topic, history depth -> publisher."""


def outputs_of(
    simulation: Simulation,
    block: SimBlock,
    make_publisher: MakePublisher,
    warn: Callable[[str], None],
) -> tuple[Output, ...]:
    """The outputs that a block asks for.

    Args:
        simulation: what is sampled.
        block: the sensor groups and geoms.
        make_publisher: called once per topic.
        warn: takes sentences about groups that say something odd.
    """
    groups = tuple(_group(simulation, group, make_publisher, warn) for group in block.groups)
    return (*groups, _geoms(simulation, block, make_publisher)) if block.geoms else groups


def _group(
    simulation: Simulation,
    group: SensorGroup,
    make_publisher: MakePublisher,
    warn: Callable[[str], None],
) -> Output:
    kind = SENSOR_KINDS[group.msg_type]
    sample = kind.build(
        SensorSource(
            model=simulation.model, data=simulation.data, names=group.sensor_names, warn=warn
        )
    )
    publish = make_publisher(kind.message_type, group.topic, group.history_depth).publish
    return Output(
        times=SampleTimes(period_s=group.period_s, step_s=simulation.step_s),
        publish=lambda stamp: publish(sample(stamp)),
    )


def _geoms(simulation: Simulation, block: SimBlock, make_publisher: MakePublisher) -> Output:
    sample = marker_sampler(simulation.model, simulation.data, block.geoms)
    publishers = [make_publisher(MarkerArray, topic, GEOM_DEPTH) for topic in GEOM_TOPICS]

    def publish(stamp: Any) -> None:
        markers = sample(stamp)
        for publisher in publishers:
            publisher.publish(markers)

    return Output(
        times=SampleTimes(period_s=block.geoms_period_s, step_s=simulation.step_s),
        publish=publish,
    )
