"""An arm of two hinges, for the tests of actuators and controls."""

import mujoco

ARM = """
<mujoco>
  <option timestep="0.002" gravity="0 0 0"/>
  <worldbody>
    <body><joint name="hip" axis="0 1 0"/><geom size="0.1" pos="0.3 0 0" mass="1"/>
      <body pos="0.6 0 0"><joint name="knee" axis="0 1 0"/>
        <geom size="0.1" pos="0.3 0 0" mass="1"/></body>
    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>
"""


def arm(actuators):
    """The model with these actuators."""
    return mujoco.MjModel.from_xml_string(ARM.format(actuators=actuators))
