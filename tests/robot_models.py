"""Small third-party robots, as inputs of `obk init --model`."""

import struct

__all__ = ["BOX", "CART", "MIXED", "MUSCLE", "PENDULUM_URDF", "TETRAHEDRON"]

CART = """<mujoco model="cart">
  <compiler angle="radian" autolimits="true"/>
  <worldbody>
    <body name="cart" pos="0 0 0.8">
      <joint name="slide" type="slide" axis="1 0 0" range="-1 1" damping="2"/>
      <geom type="box" size="0.1 0.05 0.03" mass="1"/>
      <site name="imu"/>
      <body name="pole">
        <joint name="hinge" axis="0 1 0" damping="0.01"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.02" mass="0.2"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="slide" gear="3"/></actuator>
  <sensor>
    <gyro name="turning" site="imu"/>
    <accelerometer name="shaking" site="imu"/>
  </sensor>
</mujoco>
"""
"""One motor, a passive joint, an IMU without orientation; no keyframe and no encoders."""

MIXED = """<mujoco model="mixed">
  <option timestep="0.005"/>
  <worldbody>
    <body name="trunk">
      <freejoint name="root"/>
      <geom size="0.1" mass="2"/>
      <body pos="0.2 0 0">
        <joint name="a" axis="0 1 0" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2"/>
      </body>
      <body pos="-0.2 0 0">
        <joint name="b" axis="0 1 0" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 -0.2 0 0" size="0.02" mass="0.2"/>
      </body>
      <body pos="0 0.2 0">
        <joint name="c" axis="1 0 0" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0 0.2 0" size="0.02" mass="0.2"/>
      </body>
    </body>
    <geom type="plane" size="2 2 0.1"/>
  </worldbody>
  <actuator>
    <position name="a_servo" joint="a" kp="5" kv="0.1"/>
    <velocity name="b_servo" joint="b" kv="0.2"/>
    <motor name="c_motor" joint="c" gear="2"/>
    <motor name="c_helper" joint="c" gear="-1"/>
    <motor name="a_motor" joint="a"/>
  </actuator>
  <keyframe><key name="start" qpos="0 0 1 1 0 0 0 0.2 0.3 0.4"/></keyframe>
</mujoco>
"""
"""A falling free base, actuators of three kinds, and joints with two of them."""

MUSCLE = """<mujoco model="muscle">
  <worldbody>
    <body>
      <joint name="elbow" axis="0 1 0" damping="1"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2"/>
      <site name="hand" pos="0.1 0 0.02"/>
    </body>
    <site name="shoulder" pos="0 0 0.3"/>
  </worldbody>
  <tendon><spatial name="t"><site site="shoulder"/><site site="hand"/></spatial></tendon>
  <actuator>
    <muscle name="m" tendon="t"/>
    <general name="thrust" site="hand" gear="0 0 1 0 0 0"/>
  </actuator>
</mujoco>
"""
"""No actuator drives a joint."""

BOX = """<mujoco model="box">
  <compiler meshdir="../meshes"/>
  <asset><mesh name="box" file="box.stl"/></asset>
  <worldbody>
    <body><joint name="lift" type="slide"/><geom type="mesh" mesh="box" mass="1"/></body>
  </worldbody>
  <actuator><position name="lift" joint="lift" kp="100" kv="10"/></actuator>
</mujoco>
"""
"""A mesh in a folder next to the model."""

PENDULUM_URDF = """<robot name="pendulum">
  <link name="base"/>
  <link name="rod">
    <inertial>
      <origin xyz="0 0 -0.25"/>
      <mass value="1"/>
      <inertia ixx="0.02" iyy="0.02" izz="0.001" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision>
      <geometry><mesh filename="package://pendulum/meshes/rod.stl"/></geometry>
    </collision>
  </link>
  <joint name="swing" type="revolute">
    <parent link="base"/>
    <child link="rod"/>
    <origin rpy="0 1 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="20" velocity="5"/>
  </joint>
</robot>
"""

_CORNERS = ((0.0, 0.0, 0.0), (0.02, 0.0, 0.0), (0.0, 0.02, 0.0), (0.0, 0.0, 0.02))
_FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
TETRAHEDRON = (
    bytes(80)
    + struct.pack("<I", len(_FACES))
    + b"".join(
        struct.pack("<12fH", 0, 0, 0, *(x for corner in face for x in _CORNERS[corner]), 0)
        for face in _FACES
    )
)
"""A mesh as binary STL."""
