"""Build `TrueSimState` messages: the state of the simulated robot, without noise and delay.

In: a copy of the generalised positions and velocities. Out: a message whose `y` is both, and whose
other fields are those of an estimate: the base is the body of the first free joint, the joints are
the hinge and slide joints in the order of the model. `v_base` is as MuJoCo has it: linear velocity
in the world, angular velocity in the base's own frame.
"""

from array import array
from dataclasses import dataclass

import mujoco
import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from obelisk_sensor_msgs.msg import TrueSimState

from obelisk_py.core.sim.mujoco.sensors.kind import WORLD
from obelisk_py.core.sim.mujoco.stepping import NS_PER_S

__all__ = ["StateCopy", "TrueStateReader"]

Array = NDArray[np.float64]

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True, slots=True, kw_only=True)
class StateCopy:
    """The state at one time, safe to read while the simulation continues."""

    stamp_ns: int
    qpos: Array
    """Shape `(nq,)`."""
    qvel: Array
    """Shape `(nv,)`."""


class TrueStateReader:
    """Turns copies of one model's state into messages."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Find the base and the joints of a model."""
        joints = range(model.njnt)
        base = next((j for j in joints if model.jnt_type[j] == _FREE), None)
        scalar = [j for j in joints if model.jnt_type[j] in _SCALAR]
        self._base_name = "" if base is None else model.body(int(model.jnt_bodyid[base])).name
        self._base_qpos = None if base is None else int(model.jnt_qposadr[base])
        self._base_qvel = None if base is None else int(model.jnt_dofadr[base])
        self._joint_names = [model.joint(j).name for j in scalar]
        self._joint_qpos = model.jnt_qposadr[scalar].astype(np.intp)
        self._joint_qvel = model.jnt_dofadr[scalar].astype(np.intp)

    def message(self, state: StateCopy) -> TrueSimState:
        """The message of a state."""
        message = TrueSimState()
        seconds, nanoseconds = divmod(state.stamp_ns, NS_PER_S)
        message.header.stamp = Time(sec=seconds, nanosec=nanoseconds)
        message.header.frame_id = WORLD
        message.y = _doubles(np.concatenate((state.qpos, state.qvel)))
        message.base_link_name = self._base_name
        if self._base_qpos is not None and self._base_qvel is not None:
            pose = state.qpos[self._base_qpos : self._base_qpos + 7]
            message.q_base = _doubles(pose[[0, 1, 2, 4, 5, 6, 3]])
            message.v_base = _doubles(state.qvel[self._base_qvel : self._base_qvel + 6])
        message.q_joints = _doubles(state.qpos[self._joint_qpos])
        message.v_joints = _doubles(state.qvel[self._joint_qvel])
        message.joint_names = self._joint_names
        return message


def _doubles(values: Array) -> "array[float]":
    # In this form rclpy keeps numbers as they are; anything else it converts one by one.
    return array("d", values.tobytes())
