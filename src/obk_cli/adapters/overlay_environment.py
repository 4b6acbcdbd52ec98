"""What processes need in their environment so that they find the packages of overlays.

In: variables and prefixes. Out: variables, the overlays before everything else. Writes none.
"""

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

__all__ = ["import_from", "underlays_of", "with_overlays"]


def with_overlays(variables: Mapping[str, str], overlays: Sequence[Path]) -> dict[str, str]:
    """The variables of a process that is to find these prefixes first, the nearest one first."""
    before: dict[str, list[Path]] = {
        "AMENT_PREFIX_PATH": [*overlays],
        "LD_LIBRARY_PATH": [prefix / "lib" for prefix in overlays],
        "PYTHONPATH": [*_python_folders(overlays)],
        # Read at the start of every Python of this environment, also where PYTHONPATH is not.
        "OBK_OVERLAY_PATH": [*overlays],
    }
    merged = dict(variables)
    for name, folders in before.items():
        inherited = (entry for entry in variables.get(name, "").split(":") if entry)
        if entries := dict.fromkeys((*map(str, folders), *inherited)):
            merged[name] = ":".join(entries)
    return merged


def import_from(overlays: Sequence[Path]) -> None:
    """Let this process import the packages of overlays; those it has imported stay."""
    folders = [str(folder) for folder in _python_folders(overlays)]
    sys.path[:0] = [folder for folder in folders if folder not in sys.path]


def underlays_of(environment: Mapping[str, str], overlays: Iterable[Path]) -> tuple[Path, ...]:
    """The prefixes below the overlays: those on AMENT_PREFIX_PATH, then this Python's."""
    own = {prefix.resolve() for prefix in overlays}
    listed = environment.get("AMENT_PREFIX_PATH", "").split(":")
    prefixes = dict.fromkeys(Path(prefix) for prefix in (*listed, sys.prefix) if prefix)
    return tuple(prefix for prefix in prefixes if prefix.resolve() not in own)


def _python_folders(prefixes: Iterable[Path]) -> Iterable[Path]:
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    for prefix in prefixes:
        # The second one is where Debian's Python has colcon install.
        places = (
            Path("lib", version, "site-packages"),
            Path("local/lib", version, "dist-packages"),
        )
        yield from (prefix / place for place in places if (prefix / place).is_dir())
