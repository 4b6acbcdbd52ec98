"""The modules of MuJoCo that the simulator's program imports."""

import os
import subprocess
import sys

import pytest

PROGRAM = """
import os, sys
from obelisk_py.core.sim.mujoco.__main__ import import_without_windows
before = dict(os.environ)
import_without_windows()
assert "mujoco" in sys.modules
assert dict(os.environ) == before, "the variable is as the user has it"
print("glfw" in sys.modules)
"""


@pytest.mark.parametrize("chosen", [None, "egl", "no such back end"])
def test_the_simulator_loads_no_window_system(chosen: str | None) -> None:
    variables = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    if chosen is not None:
        variables["MUJOCO_GL"] = chosen
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=variables,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("False\n", "")
