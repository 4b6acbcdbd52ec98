"""`ObeliskRobot` and `ObeliskSimRobot`: the system that is controlled, real or simulated."""

import threading
from abc import ABC, abstractmethod
from typing import Any

from obelisk_sensor_msgs.msg import TrueSimState
from rclpy.lifecycle import LifecycleState

from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.obelisk_typing import ObeliskControlMsg

__all__ = ["ObeliskRobot", "ObeliskSimRobot"]

LONGEST_STOP_S = 5.0
"""How long `run_simulator` may take to return once it is asked to [s]."""


class ObeliskRobot(ABC, ObeliskNode):
    """Base of robots.

    Registers the subscription `sub_ctrl` -> `apply_control` with the ROS parameter
    `sub_ctrl_setting`. The inheriting class registers its sensors' publishers.
    """

    def __init__(
        self, node_name: str, ctrl_msg_type: type[Any] | None = None, **kwargs: Any
    ) -> None:
        """Make the node and register the control subscription.

        Args:
            node_name: name in the ROS graph, where no remapping gives another.
            ctrl_msg_type: class of the control message; without it the config names the type.
            kwargs: handed to `rclpy.node.Node`.
        """
        super().__init__(node_name, **kwargs)
        self.register_obk_subscription(
            "sub_ctrl_setting", self._take_control, key="sub_ctrl", msg_type=ctrl_msg_type
        )

    def _take_control(self, control_msg: ObeliskControlMsg) -> None:
        # A robot that is not active must not move, whoever still publishes.
        if self.state_label == "active":
            self.apply_control(control_msg)

    @abstractmethod
    def apply_control(self, control_msg: ObeliskControlMsg) -> None:
        """Apply a control message to the system; called only while the node is active.

        Args:
            control_msg: the newest control.
        """


class ObeliskSimRobot(ObeliskRobot):
    """Base of simulated robots.

    Registers, both optional, the timer `timer_true_sim_state` -> `publish_true_sim_state` and the
    publisher `pub_true_sim_state`. While the node is active, `run_simulator` runs in a thread of
    its own.
    """

    def __init__(
        self, node_name: str, ctrl_msg_type: type[Any] | None = None, **kwargs: Any
    ) -> None:
        """Make the node and register its components.

        Args:
            node_name: name in the ROS graph, where no remapping gives another.
            ctrl_msg_type: class of the control message; without it the config names the type.
            kwargs: handed to `rclpy.node.Node`.
        """
        super().__init__(node_name, ctrl_msg_type, **kwargs)
        self.simulator_stop = threading.Event()
        """Set when `run_simulator` is to return."""
        self._simulator: threading.Thread | None = None
        self.register_obk_timer(
            "timer_true_sim_state_setting",
            self.publish_true_sim_state,
            key="timer_true_sim_state",
            required=False,
        )
        self.register_obk_publisher(
            "pub_true_sim_state_setting",
            key="pub_true_sim_state",
            msg_type=TrueSimState,
            required=False,
        )

    @abstractmethod
    def run_simulator(self) -> None:
        """Step the simulation until `simulator_stop` is set; what it raises fails the node.

        Each run has an event of its own: take `self.simulator_stop` once, at the beginning.
        """

    def publish_true_sim_state(self) -> TrueSimState:
        """Publish the simulator's own state on `pub_true_sim_state`, and return it.

        Raises:
            ObeliskConfigError: the inheriting class has no such state, yet the config asks for it.
        """
        raise ObeliskConfigError(
            f"{type(self).__name__} does not implement publish_true_sim_state, "
            "but the config sets timer_true_sim_state"
        )

    def destroy_node(self) -> None:
        """Stop the simulator's thread before the publishers go."""
        self._stop_simulator()
        super().destroy_node()

    def _start(self) -> None:
        super()._start()
        if self._simulator is None:
            # A stop of its own for each run, so that an old one cannot come back to life.
            self.simulator_stop = threading.Event()
            self._simulator = threading.Thread(
                target=self.guarded(self.run_simulator), name="simulator", daemon=True
            )
            self._simulator.start()

    def _hold(self, state: LifecycleState) -> None:
        self._stop_simulator()
        super()._hold(state)

    def _stop_simulator(self) -> None:
        self.simulator_stop.set()
        if self._simulator is None:
            return
        self._simulator.join(LONGEST_STOP_S)
        if self._simulator.is_alive():
            raise ObeliskError(
                f"run_simulator went on for {LONGEST_STOP_S:g} s after simulator_stop was set"
            )
        self._simulator = None
