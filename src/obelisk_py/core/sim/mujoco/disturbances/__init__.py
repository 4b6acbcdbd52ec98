"""What keeps a simulated sensor from being perfect: `noise`, `dropout`, `delay` of a sensor group.

`settings` types what was written, `noise` adds noise to messages, `delay` holds them back, `chance`
makes the random numbers. The same seed gives the same messages in every run.
"""

from obelisk_py.core.sim.mujoco.disturbances.chance import Chance, Dropout
from obelisk_py.core.sim.mujoco.disturbances.delay import DelayLine
from obelisk_py.core.sim.mujoco.disturbances.noise import Noise
from obelisk_py.core.sim.mujoco.disturbances.settings import Disturbances, typed_disturbances

__all__ = ["Chance", "DelayLine", "Disturbances", "Dropout", "Noise", "typed_disturbances"]
