"""Who has a package name already: Python, ROS, or something installed.

In: a name. Out: a description of its owner, or None. Looks at the interpreter and the
environment; never imports what it finds.
"""

import importlib.util
import os
import sys
from collections.abc import Iterable
from pathlib import Path

from obelisk_spec.messages import OBELISK_MESSAGES, ROS_MESSAGES

__all__ = ["ament_prefixes", "owner_of_name"]


def ament_prefixes() -> tuple[Path, ...]:
    """Where ROS packages may be installed: `AMENT_PREFIX_PATH`, then this Python's prefix."""
    listed = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return (*(Path(prefix) for prefix in listed if prefix), Path(sys.prefix))


def owner_of_name(name: str, *, own_folder: Path, prefixes: Iterable[Path]) -> str | None:
    """Who has the name, in words that follow "is"; what lies in `own_folder` does not count."""
    if name in sys.stdlib_module_names:
        return "a module of Python's standard library"
    if name in OBELISK_MESSAGES or name in ROS_MESSAGES:
        return "a ROS message package"
    shares = (prefix / "share" / name / "package.xml" for prefix in prefixes)
    installed = [path for path in shares if path.is_file() and not _inside(path, own_folder)]
    if installed:
        return f"an installed ROS package ({installed[0].parent})"
    spec = importlib.util.find_spec(name)
    # A folder without `__init__.py` on the path is no module, whatever Python makes of it.
    if spec is None or spec.origin is None or _inside(Path(spec.origin), own_folder):
        return None
    return f"an installed Python module ({spec.origin})"


def _inside(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())
