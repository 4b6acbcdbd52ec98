"""`ObeliskSensor`: the base class of nodes that publish measurements of external sensors."""

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from obelisk_py.core.components import ComponentKind
from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.node import ObeliskNode

__all__ = ["ObeliskSensor"]


class ObeliskSensor(ObeliskNode):
    """Base class of sensor nodes; subclasses register their publishers."""

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Create the components.

        Raises:
            ObeliskConfigError: the class registered no publisher.
        """
        if not any(c.kind is ComponentKind.PUBLISHER for c in self._registered_components):
            raise ObeliskConfigError(
                f"{type(self).__name__} registers no publisher; a sensor needs at least one: "
                "call register_obk_publisher in its constructor"
            )
        return super().on_configure(state)
