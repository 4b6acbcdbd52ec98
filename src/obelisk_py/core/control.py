"""`ObeliskController`: the base class of nodes that turn state estimates into control messages."""

from abc import ABC, abstractmethod
from typing import Any

from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.obelisk_typing import ObeliskControlMsg, ObeliskEstimatorMsg
from obelisk_py.core.timer_phase import LoopStage

__all__ = ["ObeliskController"]


class ObeliskController(ABC, ObeliskNode):
    """Base class of controllers.

    Registers the timer `timer_ctrl` -> `compute_control`, the publisher `pub_ctrl`, and the
    subscription `sub_est` -> `update_x_hat`, each with the ROS parameter `<key>_setting`.
    """

    loop_stage = LoopStage.CONTROL

    def __init__(
        self,
        node_name: str,
        ctrl_msg_type: type[Any] | None = None,
        est_msg_type: type[Any] | None = None,
        **kwargs: Any,
    ) -> None:
        """Create the node and register its three components.

        Args:
            node_name: name in the ROS graph, unless it is remapped.
            ctrl_msg_type: class of the control message; None uses the type from the config.
            est_msg_type: class of the estimate message; None uses the type from the config.
            kwargs: passed to `rclpy.node.Node`.
        """
        super().__init__(node_name, **kwargs)
        self.register_obk_timer("timer_ctrl_setting", self.compute_control, key="timer_ctrl")
        self.register_obk_publisher("pub_ctrl_setting", key="pub_ctrl", msg_type=ctrl_msg_type)
        self.register_obk_subscription(
            "sub_est_setting", self.update_x_hat, key="sub_est", msg_type=est_msg_type
        )
        self._has_message_types = ctrl_msg_type is not None or est_msg_type is not None

    @abstractmethod
    def update_x_hat(self, x_hat_msg: ObeliskEstimatorMsg) -> None:
        """Handle a new state estimate; called for each message on `sub_est`."""

    @abstractmethod
    def compute_control(self) -> ObeliskControlMsg | None:
        """Compute the control, publish it on `pub_ctrl` and return it; None if not ready."""
