"""colcon and the sourced ROS 2 that it needs: whether they are here, and how colcon is run."""

import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from obk_cli.errors import CommandFailedError

__all__ = ["find_colcon", "run_colcon"]


def find_colcon(environment: Mapping[str, str]) -> Path | None:
    """The program, None where it is not installed or no ROS 2 is sourced that nodes would use.

    In an environment with the ROS wheels a sourced ROS 2 is kept out, and not on
    AMENT_PREFIX_PATH.
    """
    program = shutil.which("colcon", path=environment.get("PATH"))
    own = Path(sys.prefix)
    listed = (
        Path(prefix) for prefix in environment.get("AMENT_PREFIX_PATH", "").split(":") if prefix
    )
    is_sourced = any(p != own and (p / "lib" / "librcl.so").exists() for p in listed)
    return Path(program) if program and is_sourced else None


def run_colcon(arguments: Sequence[str], workspace: Path, environment: Mapping[str, str]) -> None:
    """Run colcon in a workspace to its end; its words go to stderr.

    Raises:
        CommandFailedError: it failed.
    """
    try:
        done = subprocess.run(
            arguments, cwd=workspace, env=environment, stdout=sys.stderr, check=False
        )
    except OSError as error:
        raise CommandFailedError(f"{arguments[0]} cannot be run: {error.strerror}") from error
    if done.returncode:
        raise CommandFailedError(
            f"`{' '.join(arguments)}` failed with exit code {done.returncode}",
            help="colcon's own words are above, and in the folder log/ of the workspace",
        )
