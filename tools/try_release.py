"""Uses what is released: installed into an empty environment, outside the checkout.

In: the folder with the distributions, the lock. First obelisk-cli alone checks a config and says
what it needs to launch it; then, with everything, a new workspace is launched. Leaves the wheel of
obelisk-interfaces for this Python beside the other distributions.
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
    """An empty virtual environment of this Python, and a folder to stand in."""

    def __init__(self, folder: Path) -> None:
        """Make it."""
        self._bin = folder / "environment" / "bin"
        self._stands_in = folder / "elsewhere"
        self._stands_in.mkdir(parents=True)
        venv.create(self._bin.parent, with_pip=True)
        # Nothing of the environment that this is called from.
        foreign = ("PYTHONPATH", "VIRTUAL_ENV", "AMENT_PREFIX_PATH")
        self._variables = {k: v for k, v in os.environ.items() if k not in foreign}
        self._variables["OBK_HOME"] = str(folder / "home")

    def pip(self, *arguments: str | Path) -> None:
        """Run its pip."""
        quiet = ("--disable-pip-version-check", "-qq")
        self._run([self._bin / "python", "-m", "pip", *quiet, *arguments], expected=0)

    def obk(self, *arguments: str, expected: int = 0) -> str:
        """Run its obk; what it said."""
        print(f"wheel: obk {' '.join(arguments)}", flush=True)
        return self._run([self._bin / "obk", *arguments], expected=expected)

    def _run(self, command: Sequence[str | Path], *, expected: int) -> str:
        done = subprocess.run(
            command,
            cwd=self._stands_in,
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
    """Try the distributions; ends with 1 where something is not as it should be."""
    dist, lock = (Path(argument).resolve() for argument in sys.argv[1:])
    with tempfile.TemporaryDirectory(prefix="obk-release-") as folder:
        try_release(dist, lock, Environment(Path(folder)))


def try_release(dist: Path, lock: Path, environment: Environment) -> None:
    """Use first the one distribution, then both."""
    tool = next(dist.glob("obelisk_cli-*.whl"))
    messages = next(dist.glob("obelisk_interfaces-*.tar.gz"))
    environment.pip("install", "--constraint", lock, tool)
    for arguments in LIGHT:
        environment.obk(*arguments)
    refused = environment.obk(*LAUNCH, expected=1)
    if "pip install 'obelisk-cli[ros]'" not in refused:
        sys.exit(f"{refused}\nwheel: the launch does not say what it needs")
    environment.pip("install", "--no-deps", "--requirement", lock)
    build = ("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", dist)
    environment.pip(*build, messages)
    tag = f"cp{sys.version_info.major}{sys.version_info.minor}"
    environment.pip("install", "--no-deps", *dist.glob(f"obelisk_interfaces-*-{tag}-*.whl"))
    print(environment.obk(*LAUNCH))


if __name__ == "__main__":
    main()
