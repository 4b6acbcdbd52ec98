"""`OnnxPolicy`: run a trained network as a controller.

The config sets the network's file as `params_path`, what the network observes, and what its outputs
mean. It needs obelisk-cli's `policy` extra.
"""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import Twist
from obelisk_control_msgs.msg import PDFeedForward, PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter as RosParameter

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError
from obelisk_py.core.parameter import Parameter
from obelisk_py.core.parameter_rules import Getter
from obelisk_spec.onnx_policy import (
    COMMAND,
    PREVIOUS_ACTION,
    TERMS,
    Network,
    NetworkError,
    observation_size,
)
from obelisk_spec.suggestions import did_you_mean

__all__ = ["ActionKind", "OnnxPolicy"]

Vector = np.ndarray[tuple[int], np.dtype[np.float64]]

_STRINGS = RosParameter.Type.STRING_ARRAY
_LAYOUT = ("observation", "joints", "action_joints")
_LISTS = ("default_pose", "action_scale", "kp", "kd")
"""Parameters with one value, or one for each joint."""
_DOWN = np.array([0.0, 0.0, -1.0])


class ActionKind(StrEnum):
    """The meaning of the network's scaled outputs."""

    POSITION = "position"
    """Offsets from the default pose [rad or m], with the gains `kp` and `kd`."""
    EFFORT = "effort"
    """Efforts [N m or N]."""


class OnnxPolicy(ObeliskController):
    """Feeds the state estimate to a network, and its outputs to the actuators.

    A list with a single value applies to all joints. The observation consists of the terms in
    order, each multiplied by its scale and then clipped. `linear_velocity` and `angular_velocity`
    are those of the base in its own frame. `gravity` is the unit vector of gravity in that frame.
    `joint_positions` are relative to the default pose.
    """

    default_pose = Parameter(
        [0.0], unit="rad or m", description="default positions of the observed joints"
    )
    observation_clip = Parameter(100.0, ge=0.0, description="largest magnitude of an input")
    action_clip = Parameter(100.0, ge=0.0, description="largest magnitude of an output")
    action_scale = Parameter([1.0], description="command for an output of 1")
    kp = Parameter([0.0], ge=0.0, unit="N m/rad", description="proportional gains")
    kd = Parameter([0.0], ge=0.0, unit="N m s/rad", description="derivative gains")
    action_kind = Parameter(
        ActionKind.POSITION, live=False, description="quantity that the outputs command"
    )

    x_hat: EstimatedState | None = None
    """The latest estimate."""

    def __init__(self, node_name: str = "onnx_policy", **kwargs: Any) -> None:
        """Create the node; its topics, and the type of its commands, come from the config.

        Args:
            node_name: name in the ROS graph, unless it is remapped.
            kwargs: passed to `rclpy.node.Node`.
        """
        super().__init__(node_name, est_msg_type=EstimatedState, **kwargs)
        for name in _LAYOUT:
            self.declare_parameter(name, _STRINGS)
        self.declare_parameter("observation_scales", RosParameter.Type.DOUBLE_ARRAY)
        self._parameter_rules.add((*_LAYOUT, "observation_scales"))
        self._parameter_rules.add(_LISTS, self._check_new_lists, is_read_at_configure=False)
        if COMMAND in self._strings("observation"):
            self.register_obk_subscription(
                "sub_command_setting", self.update_command, key="sub_command", msg_type=Twist
            )

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the network, and check that its shapes match the parameters."""
        self.terms = self._strings("observation")
        self.joints = self._strings("joints")
        self.action_joints = self._strings("action_joints") or self.joints
        scales = self.get_parameter_or("observation_scales").value
        self.scales = list(scales or [1.0] * len(self.terms))
        self._check_names()
        try:
            self.network = Network(Path(self.params_path))
        except NetworkError as error:
            raise ObeliskConfigError(f"`params_path: {self.params_path}`: {error}") from error
        actions = len(self.action_joints)
        size = observation_size(self.terms, joints=len(self.joints), actions=actions)
        _check_width("observation", size, self.network.inputs)
        _check_width("action", actions, self.network.outputs)
        self._check_lists(partial(getattr, self))
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Reset the state, actions and commands of an earlier activation."""
        self.x_hat = None
        self.command = np.zeros(3)
        self.action = np.zeros(len(self.action_joints))
        return super().on_activate(state)

    def update_x_hat(self, x_hat_msg: EstimatedState) -> None:
        """Store the latest state estimate."""
        self.x_hat = x_hat_msg

    def update_command(self, msg: Twist) -> None:
        """Store the latest command: velocities along x and y [m/s] and about z [rad/s]."""
        self.command = np.array([msg.linear.x, msg.linear.y, msg.angular.z])

    def compute_control(self) -> PositionSetpoint | PDFeedForward | None:
        """Publish the network's action; nothing before the first estimate.

        Raises:
            ObeliskError: the network returned a number that is not finite.
        """
        if self.x_hat is None:
            return None
        action = self.network(self.observe(self.x_hat))
        if not np.isfinite(action).all():
            raise ObeliskError(f"the network returned {action.tolist()}; no command is published")
        self.action = np.clip(action, -self.action_clip, self.action_clip)
        msg = self._control_message(self.action * self._each(self.action_scale, len(action)))
        msg.header.stamp = self.x_hat.header.stamp
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg

    def observe(self, x_hat: EstimatedState) -> Vector:
        """Compute the input of the network, shape (inputs,).

        Raises:
            ObeliskError: the estimate lacks a joint or the state of a base.
        """
        values = self._values(x_hat)
        observed = [
            np.asarray(values[term]) * scale
            for term, scale in zip(self.terms, self.scales, strict=True)
        ]
        row: Vector = np.concatenate(observed)
        return row.clip(-self.observation_clip, self.observation_clip)

    def _values(self, x_hat: EstimatedState) -> Mapping[str, Vector]:
        try:
            places = [x_hat.joint_names.index(name) for name in self.joints]
        except ValueError:
            lacking = sorted(set(self.joints) - set(x_hat.joint_names))
            raise ObeliskError(
                f"the estimate has no joint {', '.join(lacking)}; it has {x_hat.joint_names}"
            ) from None
        values = {
            "joint_positions": np.array(x_hat.q_joints)[places] - self.default_pose,
            "joint_velocities": np.array(x_hat.v_joints)[places],
            PREVIOUS_ACTION: self.action,
            COMMAND: self.command,
        }
        if not set(self.terms) <= values.keys():
            values |= _base_values(x_hat)
        return values

    def _control_message(self, scaled: Vector) -> PositionSetpoint | PDFeedForward:
        """Build the command for scaled outputs, shape (actions,)."""
        is_position = self.action_kind is ActionKind.POSITION
        if is_position:
            pose = dict(zip(self.joints, self._each(self.default_pose), strict=True))
            scaled = scaled + [pose.get(name, 0.0) for name in self.action_joints]
        kind: Any = self.obk_publishers["pub_ctrl"].msg_type
        if kind is PositionSetpoint:
            return PositionSetpoint(u_mujoco=scaled.tolist())
        zeros = [0.0] * len(scaled)
        return PDFeedForward(
            joint_names=self.action_joints,
            pos_target=scaled.tolist() if is_position else zeros,
            vel_target=zeros,
            feed_forward=zeros if is_position else scaled.tolist(),
            kp=self._each(self.kp, len(scaled)),
            kd=self._each(self.kd, len(scaled)),
        )

    def _each(self, values: Sequence[float], count: int | None = None) -> list[float]:
        """Return one value per joint."""
        return [float(value) for value in np.broadcast_to(values, count or len(self.joints))]

    def _strings(self, name: str) -> list[str]:
        return list(self.get_parameter_or(name).value or ())

    def _check_new_lists(self, value: Getter) -> None:
        # Before configure, the numbers of joints and actions may still change.
        if self.state_label not in ("unconfigured", "configuring"):
            self._check_lists(value)

    def _check_lists(self, value: Getter) -> None:
        """Check the lengths of the lists in the parameters; `value` returns a parameter by name."""
        for name in _LISTS:
            values, of = value(name), self.joints if name == "default_pose" else self.action_joints
            if len(values) not in (1, len(of)):
                expected = f"1 or {len(of)}" if len(of) > 1 else "1"
                raise ObeliskConfigError(f"`{name}` has {len(values)} values, expected {expected}")

    def _check_names(self) -> None:
        if not self.terms or not self.joints:
            raise ObeliskConfigError("OnnxPolicy needs the parameters `observation` and `joints`")
        for term in self.terms:
            if term not in TERMS:
                raise ObeliskConfigError(
                    f"`observation` has no term `{term}`; {did_you_mean(term, TERMS)}"
                )
        if len(self.scales) != len(self.terms):
            raise ObeliskConfigError(
                f"`observation_scales` has {len(self.scales)} values, "
                f"`observation` has {len(self.terms)} terms; these must be equal"
            )


def _base_values(x_hat: EstimatedState) -> Mapping[str, Vector]:
    """Compute the velocities of the base, and gravity, in the frame of the base."""
    if len(x_hat.q_base) != 7 or len(x_hat.v_base) != 6:
        raise ObeliskError("the policy observes a base, but the estimate has none")
    x, y, z, w = x_hat.q_base[3:]
    # Rows are the axes of the base in the world, so this rotates vectors from the world to the
    # base.
    to_base = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
            [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
            [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return {
        "linear_velocity": to_base @ np.array(x_hat.v_base[:3]),
        "angular_velocity": np.array(x_hat.v_base[3:]),
        "gravity": to_base @ _DOWN,
    }


def _check_width(what: str, expected: int, found: int | None) -> None:
    if found is not None and found != expected:
        raise ObeliskConfigError(
            f"the network's {what} has {found} numbers, expected {expected} from the parameters"
        )
