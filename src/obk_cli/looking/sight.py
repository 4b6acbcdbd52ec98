"""Who tells of a ROS graph: the launcher of a stack on this host, else a participant of our own.

The launcher knows the whole graph already and answers in some ms; a participant has to load ROS and
to be told of everybody first.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Union

from obk_cli.adapters.launcher_look import LauncherLook, LauncherParameters, ask_launcher
from obk_cli.looking.names import meant
from obk_cli.looking.place import Place

if TYPE_CHECKING:
    from obk_cli.ros.parameters import NodeParameters
    from obk_cli.ros.participant import RosLook

__all__ = ["Parameters", "Sight", "open_sight", "parameters_of"]

Sight = Union[LauncherLook, "RosLook"]
"""A graph that is looked at."""
Parameters = Union[LauncherParameters, "NodeParameters"]
"""The parameters of one node."""


@contextmanager
def open_sight(
    place: Place, node: str | None = None, *, asks_nodes: bool = False
) -> Iterator[Sight]:
    """The graph of a place.

    Args:
        place: where to look.
        node: as a user names it; a launcher answers for the nodes of its stack only. None: of none.
        asks_nodes: whether nodes will be asked for their parameters.

    Raises:
        CommandFailedError: no launcher answers, and there is no rclpy, or it does not start.
    """
    is_ours = node is None or len(meant(node, place.nodes)) == 1
    told = ask_launcher(place.runs) if is_ours else None
    if told is not None:
        yield told
        return

    from obk_cli.ros.parameters import MODULES
    from obk_cli.ros.participant import open_look

    with open_look(place.environment, MODULES if asks_nodes else ()) as look:
        yield look


def parameters_of(sight: Sight, node: str, timeout_s: float) -> Parameters:
    """The parameters of a node.

    Args:
        sight: where the node was seen.
        node: full name.
        timeout_s: for each answer [s].
    """
    if isinstance(sight, LauncherLook):
        return sight.parameters(node, timeout_s)

    from obk_cli.ros.parameters import NodeParameters

    return NodeParameters(sight, node, timeout_s)
