"""Who has a package name already: Python, ROS, the workspace, or something installed.

In: a name. Out: a description of its owner, or None. Looks at the interpreter and at folders;
never imports what it finds.
"""

import importlib.util
import sys
from pathlib import Path

from obelisk_spec.messages import OBELISK_MESSAGES, ROS_MESSAGES
from obk_cli.adapters.packages import PackageIndex

__all__ = ["owner_of_module", "owner_of_package"]


def owner_of_module(name: str) -> str | None:
    """Who has a module name that must not be had twice, in words that follow "is"."""
    return "a module of Python's standard library" if name in sys.stdlib_module_names else None


def owner_of_package(name: str, *, own_folder: Path, index: PackageIndex) -> str | None:
    """Who has a package name, in words that follow "is"; what is in `own_folder` does not count."""
    module = owner_of_module(name)
    if module is not None:
        return module
    if name in OBELISK_MESSAGES or name in ROS_MESSAGES:
        return "a ROS message package"
    share = index.find_package_share(name)
    if share is not None and not _inside(share, own_folder):
        return f"a ROS package ({share})"
    spec = importlib.util.find_spec(name)
    # A folder without `__init__.py` on the path is no module, whatever Python makes of it.
    if spec is None or spec.origin is None or _inside(Path(spec.origin), own_folder):
        return None
    return f"an installed Python module ({spec.origin})"


def _inside(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())
