"""Run `obk` as if only obelisk-cli and its required dependencies were installed.

It takes command lines as JSON in the first argument and runs them one after another. It prints the
exit code, output and errors of each as JSON.
"""

import contextlib
import io
import json
import os
import re
import sys
import sysconfig
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import packages_distributions, requires
from pathlib import Path
from types import ModuleType

SITE = sysconfig.get_path("purelib")


def needed(distribution: str) -> set[str]:
    """The name of a distribution and the names of its dependencies without extras."""
    found, wanted = set[str](), [distribution]
    while wanted:
        name = wanted.pop()
        if name not in found:
            found.add(name)
            lines = [line for line in requires(name) or () if ";" not in line]
            wanted += [normal(re.split(r"[^\w.-]", line)[0]) for line in lines]
    return found


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


class Light:
    """Finds only the modules of some installed distributions."""

    find_distributions = staticmethod(PathFinder.find_distributions)

    def __init__(self, distributions: set[str]) -> None:
        self._modules = {
            module
            for module, names in packages_distributions().items()
            if distributions.intersection(map(normal, names))
        }

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        spec = PathFinder.find_spec(name, path, target)
        is_installed = spec is not None and path is None and SITE in str(spec.origin)
        return None if is_installed and name not in self._modules else spec


def prefix_without_python(prefix: Path) -> str:
    """Create a prefix with the nodes and shares of this environment, but not its packages."""
    (prefix / "lib").mkdir(parents=True)
    (prefix / "share").symlink_to(Path(sys.prefix, "share"))
    for folder in Path(sys.prefix, "lib").iterdir():
        if not folder.name.startswith("python"):
            (prefix / "lib" / folder.name).symlink_to(folder)
    return str(prefix)


def run(arguments: list[str]) -> tuple[object, str, str]:
    from obk_cli.cli.main import main

    streams = [io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in "oe"]
    with contextlib.redirect_stdout(streams[0]), contextlib.redirect_stderr(streams[1]):
        try:
            main(arguments)
        except SystemExit as ended:
            out, err = (stream.buffer.getvalue().decode() for stream in streams)
            return ended.code, out, err


if __name__ == "__main__":
    sys.prefix = prefix_without_python(Path("prefix").absolute())
    os.environ.pop("AMENT_PREFIX_PATH", None)  # set by the ROS wheels
    sys.meta_path[sys.meta_path.index(PathFinder)] = Light(needed("obelisk-cli"))  # type: ignore[call-overload]
    print(json.dumps([run(line) for line in json.loads(sys.argv[1])]))
