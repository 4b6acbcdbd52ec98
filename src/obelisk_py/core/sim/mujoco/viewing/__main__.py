"""Runs an onlooker as a process: `python -m obelisk_py.core.sim.mujoco.viewing KIND ...`."""

import sys

from obelisk_py.core.sim.mujoco.viewing.program import run

__all__ = ["main"]


def main() -> int:
    """Be the onlooker that the robot asked for."""
    kind, link_fd, model_fd, *arguments = sys.argv[1:]
    return run(kind, int(link_fd), int(model_fd), arguments)


if __name__ == "__main__":
    sys.exit(main())
