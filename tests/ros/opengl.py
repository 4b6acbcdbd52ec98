"""Whether this machine can render cameras, for the tests of images."""

import subprocess
import sys

import pytest

__all__ = ["require_opengl"]

OPEN = (
    "from obelisk_py.core.sim.mujoco.cameras import choose_back_end, open_context\n"
    "open_context(choose_back_end(), 16, 16)\n"
)


def require_opengl() -> None:
    """Skip the test if OpenGL is not available, which a separate process checks."""
    tried = subprocess.run(
        [sys.executable, "-c", OPEN], capture_output=True, text=True, timeout=120, check=False
    )
    if tried.returncode != 0:
        pytest.skip(tried.stderr.rpartition("Error: ")[2].strip() or "OpenGL cannot be opened")
