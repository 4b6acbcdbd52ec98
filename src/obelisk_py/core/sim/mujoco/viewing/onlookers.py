"""Who looks at a simulation: from ROS parameters to processes and outputs of the stepping thread.

In: the node's parameters. Out: an output per onlooker, that hands it the state. A new kind of
onlooker has its parameters here.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.stepper import Output
from obelisk_py.core.sim.mujoco.stepping import SampleTimes
from obelisk_py.core.sim.mujoco.viewing.child import Onlooker
from obelisk_py.core.sim.mujoco.viewing.words import Tell

__all__ = ["PARAMETERS", "Wish", "onlooker_outputs", "wishes_of"]

PARAMETERS: Final[Mapping[str, str | int]] = MappingProxyType({"viewer": "none", "viewer_port": 0})
"""ROS parameter -> its default, whose type it keeps."""
VIEWERS: Final = ("none", "native", "web")
_HIGHEST_PORT: Final = 65535


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """One onlooker that is asked for."""

    kind: str
    """A key of `program.KINDS`."""
    arguments: tuple[str, ...] = ()


def wishes_of(parameter: Callable[[str], Any]) -> tuple[Wish, ...]:
    """The onlookers that a node's parameters ask for.

    Args:
        parameter: gives the value of one of `PARAMETERS`.

    Raises:
        ObeliskConfigError: a value means nothing.
    """
    return tuple(_viewer(parameter))


def onlooker_outputs(
    simulation: Simulation,
    wishes: Iterable[Wish],
    steps_per_view: int,
    *,
    tell: Tell,
    on_close: Callable[[Callable[[], None]], object],
) -> tuple[Output, ...]:
    """Start onlookers; the outputs that hand them states.

    Args:
        simulation: what they look at.
        wishes: which onlookers.
        steps_per_view: how many steps lie between two states.
        tell: takes what they say; called on threads of their own.
        on_close: takes what has to be called when the simulation is freed.
    """
    outputs = []
    for wish in wishes:
        onlooker = Onlooker(wish.kind, wish.arguments, simulation.model, simulation.data, tell=tell)
        on_close(onlooker.close)
        outputs.append(_output(onlooker, steps_per_view))
    return tuple(outputs)


def _output(onlooker: Onlooker, steps_per_view: int) -> Output:
    send = onlooker.states.send

    def publish(_stamp: Any) -> None:
        send()

    return Output(
        times=SampleTimes(period_s=float(steps_per_view), step_s=1.0),
        publish=publish,
        # The start of a run is seen too.
        restart=send,
    )


def _viewer(parameter: Callable[[str], Any]) -> list[Wish]:
    viewer, port = parameter("viewer"), parameter("viewer_port")
    if viewer not in VIEWERS:
        raise ObeliskConfigError(
            f"the parameter `viewer` is `{viewer}`; there are: {', '.join(VIEWERS)}"
        )
    if not 0 <= port <= _HIGHEST_PORT:
        raise ObeliskConfigError(
            f"the parameter `viewer_port` is {port}; expected a port from 1 to {_HIGHEST_PORT}, "
            "or 0 for a free one"
        )
    if viewer == "none":
        return []
    return [Wish(kind=viewer, arguments=(str(port),) if viewer == "web" else ())]
