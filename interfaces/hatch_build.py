"""Build hook of obelisk-interfaces: compiles the message packages and adds them to the wheel.

Reads the package folders next to this file and writes the wheel's `lib/`, `include/`, `share/` and
Python packages. Compiled files are kept in `build/`, so that a second build is fast.
"""

import importlib.util
import shutil
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

import obk_interfaces
from obk_interfaces.prefix import site_packages_in

__all__ = ["InterfacesHook"]


class InterfacesHook(BuildHookInterface[Any]):
    """Builds every interface package of this folder into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the packages and list their files in `build_data`.

        Raises:
            RuntimeError: an editable install was requested, which compiled messages do not support.
            obk_interfaces.InterfaceError: the build failed.
        """
        if version == "editable":
            raise RuntimeError("compiled messages cannot be editable: install without -e")
        root = Path(self.root)
        work = root / "build" / str(sys.implementation.cache_tag)
        stage = work / "stage"
        shutil.rmtree(stage, ignore_errors=True)
        report = obk_interfaces.build(
            obk_interfaces.discover(sorted(root.glob("obelisk_*_msgs"))),
            build_dir=work / "packages",
            prefix=stage,
        )
        self.app.display_info(f"built: {report.built}, unchanged: {report.unchanged}")
        build_data["pure_python"] = False
        build_data["infer_tag"] = True
        build_data["force_include"].update(_egg_info_guards(work / "guards"))
        for file in sorted(f for f in stage.rglob("*") if f.is_file()):
            site = site_packages_in(stage)
            is_python = file.is_relative_to(site)
            kind, base = ("force_include", site) if is_python else ("shared_data", stage)
            build_data[kind][str(file)] = str(file.relative_to(base))


def _egg_info_guards(folder: Path) -> dict[str, str]:
    """Return files that keep `uv sync` from deleting the Python packages of the ROS wheels.

    Those wheels have stray `*.egg-info` folders. uv considers them packages that are not locked
    and removes every module in their `top_level.txt` that is not in `namespace_packages.txt`.
    """
    spec = importlib.util.find_spec("ros_wheels_bootstrapper")
    if spec is None or spec.origin is None:
        return {}  # ROS 2 is sourced, so its packages are not in this environment
    site = Path(spec.origin).parents[1]
    folder.mkdir(parents=True, exist_ok=True)
    guards: dict[str, str] = {}
    for names in sorted(site.glob("*.egg-info/top_level.txt")):
        egg = names.parent.name
        spared, emptied = folder / f"{egg}.spared", folder / f"{egg}.emptied"
        spared.write_text(names.read_text())
        emptied.write_text("")
        guards[str(spared)] = f"{egg}/namespace_packages.txt"
        guards[str(emptied)] = f"{egg}/top_level.txt"
    return guards
