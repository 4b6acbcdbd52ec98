"""Try the built distributions in an empty environment outside the checkout.

It takes the folder of the distributions and the lock file. First runs the commands that need only
obelisk-cli, and checks that `obk launch` names the missing extra. Then installs everything and
launches a new workspace. It leaves the wheel of obelisk-interfaces for this Python in the folder.
"""

import os
import subprocess
import sys
import tempfile
import venv
from collections.abc import Sequence
from pathlib import Path

__all__ = ["main"]

ROBOT = "my_robot"
LIGHT = (
    ("--version",),
    ("init", ROBOT),
    ("new", "controller", "other", "--dest", f"{ROBOT}/src"),
    ("validate", f"{ROBOT}/{ROBOT}.yaml"),
    ("compile", f"{ROBOT}/{ROBOT}.yaml", "--to", "params"),
    ("graph", f"{ROBOT}/{ROBOT}.yaml"),
    ("explain", "OBK303"),
    ("schema",),
    ("migrate", f"{ROBOT}/{ROBOT}.yaml", "--to", "seed"),
)
"""Commands that need no extra."""
LAUNCH = ("launch", f"{ROBOT}/{ROBOT}.yaml", "--duration", "5")


class Environment:
    """An empty virtual environment of this Python, and a working folder."""

    def __init__(self, folder: Path) -> None:
        """Create the environment."""
        self._bin = folder / "environment" / "bin"
        self._working_folder = folder / "elsewhere"
        self._working_folder.mkdir(parents=True)
        venv.create(self._bin.parent, with_pip=True)
        # Inherit nothing from the calling environment.
        foreign = ("PYTHONPATH", "VIRTUAL_ENV", "AMENT_PREFIX_PATH")
        self._variables = {k: v for k, v in os.environ.items() if k not in foreign}
        self._variables["OBK_HOME"] = str(folder / "home")

    def pip(self, *arguments: str | Path) -> None:
        """Run its pip."""
        quiet = ("--disable-pip-version-check", "-qq")
        self._run([self._bin / "python", "-m", "pip", *quiet, *arguments], expected=0)

    def obk(self, *arguments: str, expected: int = 0) -> str:
        """Run its obk and return the output."""
        print(f"wheel: obk {' '.join(arguments)}", flush=True)
        return self._run([self._bin / "obk", *arguments], expected=expected)

    def _run(self, command: Sequence[str | Path], *, expected: int) -> str:
        done = subprocess.run(
            command,
            cwd=self._working_folder,
            env=self._variables,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        if done.returncode != expected:
            words = " ".join(map(str, command))
            sys.exit(f"{done.stdout}\nwheel: {words}: exit code {done.returncode}")
        return done.stdout


def main() -> None:
    """Try the distributions; exit with 1 if anything fails."""
    dist, lock = (Path(argument).resolve() for argument in sys.argv[1:])
    with tempfile.TemporaryDirectory(prefix="obk-release-") as folder:
        try_release(dist, lock, Environment(Path(folder)))


def try_release(dist: Path, lock: Path, environment: Environment) -> None:
    """Try obelisk-cli alone, then both distributions."""
    tool = next(dist.glob("obelisk_cli-*.whl"))
    messages = next(dist.glob("obelisk_interfaces-*.tar.gz"))
    environment.pip("install", "--constraint", lock, tool)
    for arguments in LIGHT:
        environment.obk(*arguments)
    output = environment.obk(*LAUNCH, expected=1)
    if "obelisk-cli[ros]" not in output:
        sys.exit(f"{output}\nwheel: `obk launch` does not name the missing extra")
    environment.pip("install", "--no-deps", "--requirement", lock)
    build = ("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", dist)
    environment.pip(*build, messages)
    tag = f"cp{sys.version_info.major}{sys.version_info.minor}"
    environment.pip("install", "--no-deps", *dist.glob(f"obelisk_interfaces-*-{tag}-*.whl"))
    print(environment.obk(*LAUNCH))


if __name__ == "__main__":
    main()
