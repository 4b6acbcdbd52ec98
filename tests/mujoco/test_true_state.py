"""`TrueSimState` compared with the state itself."""

import mujoco
import numpy as np
import pytest

from obelisk_py.core.sim.mujoco.robot import StateCopy, TrueStateReader

pytestmark = pytest.mark.mujoco


def _message(model, data):
    copy = StateCopy(stamp_ns=3_000_000_000, qpos=data.qpos.copy(), qvel=data.qvel.copy())
    return TrueStateReader(model).message(copy)


def test_a_floating_robot_has_a_base_and_joints(everything, moving):
    message = _message(everything, moving)
    assert message.header.stamp.sec == 3
    assert message.base_link_name == "base"
    assert message.joint_names == ["left_hip", "left_slide", "right_hip"]
    assert message.y.tolist() == [*moving.qpos, *moving.qvel]
    body = moving.body("base")
    w, x, y, z = body.xquat
    assert np.allclose(message.q_base, [*body.xpos, x, y, z, w], atol=1e-12)
    assert message.v_base.tolist() == moving.joint("root").qvel.tolist()
    in_world, in_base = np.empty(6), np.empty(6)
    object_of = (mujoco.mjtObj.mjOBJ_XBODY, everything.body("base").id)
    mujoco.mj_objectVelocity(everything, moving, *object_of, in_world, 0)
    mujoco.mj_objectVelocity(everything, moving, *object_of, in_base, 1)
    assert np.allclose(message.v_base, [*in_world[3:], *in_base[:3]], atol=1e-12)
    assert not np.allclose(in_world, in_base, atol=1e-2)
    assert message.q_joints.tolist() == [moving.joint(n).qpos[0] for n in message.joint_names]
    assert message.v_joints.tolist() == [moving.joint(n).qvel[0] for n in message.joint_names]


def test_a_robot_with_a_fixed_base_has_joints_only(dummy):
    data = mujoco.MjData(dummy)
    mujoco.mj_resetDataKeyframe(dummy, data, 1)
    message = _message(dummy, data)
    assert message.base_link_name == ""
    assert (len(message.q_base), len(message.v_base)) == (0, 0)
    assert message.q_joints.tolist() == [-1.0]
