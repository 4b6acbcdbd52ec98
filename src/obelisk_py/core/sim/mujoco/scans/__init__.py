"""Ray casters: from the `scan_config` of a sensor group to distances, one module per step.

`settings` types what was written, `rays` lays the rays out, `caster` casts them at the present
state, `frames` finds the frame that points are given in. Messages are made in `sensors`.
"""

from obelisk_py.core.sim.mujoco.scans.caster import LevelCaster, Scan, SiteCaster, make_caster
from obelisk_py.core.sim.mujoco.scans.settings import RayCaster, typed_ray_caster

__all__ = ["LevelCaster", "RayCaster", "Scan", "SiteCaster", "make_caster", "typed_ray_caster"]
