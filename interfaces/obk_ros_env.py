"""Start hook of the interpreter that makes it use this environment's ROS 2 and no other.

`obk_ros_env.pth` calls `activate()` at every start of Python, so it is cheap and uses only the
standard library. It does three things:

- ament index: put this environment and its overlays first in `AMENT_PREFIX_PATH`;
- overlays (message packages built by `obk build`): make their Python packages importable;
- libraries: add those of the overlays to `LD_LIBRARY_PATH`. If ROS 2 comes from wheels, add its
  libraries too, in a fixed order, and remove those of a ROS 2 that the shell has sourced. The
  dynamic loader reads that variable only when a process starts, so the interpreter re-executes
  itself once.

If ROS 2 was sourced and no overlay exists, only the first step happens. The name of this hook
sorts before that of the ROS wheels, which does the last step in random order.
"""

import os
import sys

__all__ = ["activate"]

_DONE = "_OBK_ROS_ENV"
_WHEELS_DONE = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"


def activate() -> None:
    """Set the environment of this process; re-execute the interpreter if the loader needs it."""
    site = os.path.dirname(os.path.abspath(__file__))
    prefix = os.path.dirname(os.path.dirname(os.path.dirname(site)))
    overlays = _overlays(prefix)
    layers = [*overlays, prefix]
    has_wheels = _has_ros(prefix)
    foreign = [p for p in _entries("AMENT_PREFIX_PATH") if p not in layers]
    if has_wheels:
        foreign = [p for p in foreign if not _has_ros(p)]
    os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join(layers + foreign)
    sys.path[:0] = [s for s in map(_site_of, overlays) if os.path.isdir(s) and s not in sys.path]
    if has_wheels or overlays:
        _restart_unless(_wanted(layers, site, has_wheels), prefix)
    if has_wheels:
        os.environ[_WHEELS_DONE] = "1"


def _wanted(layers: list[str], site: str, has_wheels: bool) -> dict[str, list[str]]:
    """Return the search paths that the loader and the imports need."""
    if not has_wheels:
        ours = [os.path.join(layer, "lib") for layer in layers]
        others = [folder for folder in _entries("LD_LIBRARY_PATH") if folder not in ours]
        return {"LD_LIBRARY_PATH": ours + others}
    return {
        "LD_LIBRARY_PATH": _libraries(layers, site),
        # A sourced ROS 2 adds its Python packages here, which do not work with these libraries.
        "PYTHONPATH": [p for p in _entries("PYTHONPATH") if not _exists(p, "rclpy")],
    }


def _restart_unless(wanted: dict[str, list[str]], prefix: str) -> None:
    """Re-execute the interpreter with these paths unless it has them; at most once."""
    if all(_entries(name) == value for name, value in wanted.items()):
        return
    this_process = f"{prefix}:{os.getpid()}"
    if os.environ.get(_DONE) == this_process or not sys.executable or not sys.orig_argv:
        return
    for name, value in wanted.items():
        if value:
            os.environ[name] = os.pathsep.join(value)
        else:
            os.environ.pop(name, None)
    os.environ[_DONE] = this_process
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])  # noqa: S606 - as it was started


def _libraries(layers: list[str], site: str) -> list[str]:
    """Return the library folders: ours first, then other folders without a ROS 2."""
    private = sorted(
        entry.path
        for entry in os.scandir(site)
        if entry.name.startswith("ros_") and entry.name.endswith(".libs")
    )
    ours = [os.path.join(layer, "lib") for layer in layers] + private
    return ours + [
        folder
        for folder in _entries("LD_LIBRARY_PATH")
        if folder not in ours and not _exists(folder, "librcl.so") and not _is_private(folder)
    ]


def _is_private(folder: str) -> bool:
    name = os.path.basename(folder)
    return name.startswith("ros_") and name.endswith(".libs")


def _overlays(prefix: str) -> list[str]:
    own = os.path.join(prefix, "overlay")
    found = _entries("OBK_OVERLAY_PATH") + ([own] if os.path.isdir(own) else [])
    return list(dict.fromkeys(found))


def _site_of(prefix: str) -> str:
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    return os.path.join(prefix, "lib", version, "site-packages")


def _has_ros(prefix: str) -> bool:
    return _exists(prefix, "lib", "librcl.so")


def _exists(*parts: str) -> bool:
    return os.path.exists(os.path.join(*parts))


def _entries(name: str) -> list[str]:
    return [entry for entry in os.environ.get(name, "").split(os.pathsep) if entry]
