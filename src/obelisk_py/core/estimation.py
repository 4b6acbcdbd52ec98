"""`ObeliskEstimator`: the base class of nodes that turn sensor messages into state estimates."""

from abc import ABC, abstractmethod
from typing import Any

from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.obelisk_typing import ObeliskEstimatorMsg
from obelisk_py.core.timer_phase import LoopStage

__all__ = ["ObeliskEstimator"]


class ObeliskEstimator(ABC, ObeliskNode):
    """Base class of state estimators.

    Registers the timer `timer_est` -> `compute_state_estimate` and the publisher `pub_est`, each
    with the ROS parameter `<key>_setting`. Subclasses register the subscriptions of their sensors.
    """

    loop_stage = LoopStage.ESTIMATE

    def __init__(
        self, node_name: str, est_msg_type: type[Any] | None = None, **kwargs: Any
    ) -> None:
        """Create the node and register its two components.

        Args:
            node_name: name in the ROS graph, unless it is remapped.
            est_msg_type: class of the estimate message; None uses the type from the config.
            kwargs: passed to `rclpy.node.Node`.
        """
        super().__init__(node_name, **kwargs)
        self.register_obk_timer("timer_est_setting", self.compute_state_estimate, key="timer_est")
        self.register_obk_publisher("pub_est_setting", key="pub_est", msg_type=est_msg_type)
        self._has_message_types = est_msg_type is not None

    @abstractmethod
    def compute_state_estimate(self) -> ObeliskEstimatorMsg | None:
        """Compute the estimate, publish it on `pub_est` and return it; None if not ready."""
