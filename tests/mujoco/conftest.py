"""Models for the simulator's tests: that of the example, and one with all kinds of elements."""

import mujoco
import numpy as np
import pytest

EVERYTHING = """
<mujoco model="everything">
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <asset>
    <material name="red" rgba="1 0 0 0.5"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <geom name="shelf" type="box" pos="1 2 0.5" size="0.1 0.2 0.3" rgba="0 1 0 1"/>
    <geom name="rod" type="capsule" pos="-1 0 1" euler="0 1.5707963267948966 0" size="0.05 0.4"
          material="red"/>
    <body name="base" pos="0 0 0.6" euler="0.1 0.2 0.3">
      <freejoint name="root"/>
      <geom name="trunk" type="ellipsoid" size="0.2 0.1 0.05"/>
      <camera name="ahead" pos="0.2 0 0" euler="1.5707963267948966 -1.5707963267948966 0"
              resolution="64 48"/>
      <site name="imu" pos="0.03 0.01 0.02" euler="0.4 -0.2 1.1"/>
      <site name="centre"/>
      <body name="left" pos="0 0.2 0">
        <joint name="left_hip" type="hinge" axis="0 1 0"/>
        <geom name="thigh" type="cylinder" pos="0 0 -0.1" size="0.03 0.1"/>
        <body name="left_shin" pos="0 0 -0.2">
          <joint name="left_slide" type="slide" axis="0 0 1"/>
          <geom name="foot" type="sphere" size="0.04"/>
          <site name="toe"/>
          <site name="sole" size="0.06"/>
        </body>
      </body>
      <body name="right" pos="0 -0.2 0">
        <joint name="right_hip" type="hinge" axis="0 1 0"/>
        <geom type="sphere" pos="0 0 -0.1" size="0.04"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="left" joint="left_hip"/>
    <motor name="right" joint="right_hip"/>
  </actuator>
  <sensor>
    <jointpos name="right_hip_pos" joint="right_hip"/>
    <jointpos name="left_slide_pos" joint="left_slide"/>
    <jointpos name="left_hip_pos" joint="left_hip"/>
    <jointvel name="left_hip_vel" joint="left_hip"/>
    <jointvel name="left_slide_vel" joint="left_slide"/>
    <jointvel name="right_hip_vel" joint="right_hip"/>
    <accelerometer name="acc" site="imu"/>
    <gyro name="gyro" site="imu"/>
    <framequat name="imu_quat" objtype="site" objname="imu"/>
    <velocimeter name="velocity" site="imu"/>
    <framepos name="centre_pos" objtype="site" objname="centre"/>
    <framequat name="centre_quat" objtype="site" objname="centre"/>
    <velocimeter name="centre_velocity" site="centre"/>
    <gyro name="centre_gyro" site="centre"/>
    <velocimeter name="toe_velocity" site="toe"/>
    <framepos name="toe_in_base" objtype="site" objname="toe" reftype="body" refname="base"/>
    <framequat name="toe_quat_in_base" objtype="site" objname="toe" reftype="body" refname="base"/>
    <force name="toe_force" site="toe"/>
    <force name="hip_force" site="imu"/>
    <touch name="sole_touch" site="sole"/>
    <framequat name="toe_quat" objtype="site" objname="toe"/>
  </sensor>
</mujoco>
"""


@pytest.fixture(scope="session")
def dummy_xml(repository):
    return repository / "examples" / "dummy" / "dummy.xml"


@pytest.fixture
def dummy(dummy_xml):
    return mujoco.MjModel.from_xml_path(str(dummy_xml))


@pytest.fixture
def everything():
    return mujoco.MjModel.from_xml_string(EVERYTHING)


@pytest.fixture
def everything_xml(tmp_path):
    path = tmp_path / "everything.xml"
    path.write_text(EVERYTHING)
    return path


@pytest.fixture
def moving(everything):
    """The model in a state without zeros, with all of its sensors computed."""
    data = mujoco.MjData(everything)
    random = np.random.default_rng(7)
    data.qpos[:] += random.uniform(-0.3, 0.3, everything.nq)
    data.qvel[:] = random.uniform(-1, 1, everything.nv)
    data.ctrl[:] = random.uniform(-1, 1, everything.nu)
    mujoco.mj_normalizeQuat(everything, data.qpos)
    mujoco.mj_forward(everything, data)
    return data
