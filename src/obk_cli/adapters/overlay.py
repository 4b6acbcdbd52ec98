"""The overlay of a workspace: where compiled message packages lie, and what it says of itself.

`<workspace>/.obk/overlay` is a prefix with `lib/`, `include/` and `share/`; `overlay.json` in it is
the record of what it holds. Only reads; `overlay_change` is what replaces it.
"""

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from obk_cli.adapters.planted import is_planted

__all__ = [
    "FOLDER",
    "RECORD",
    "Builder",
    "BuiltPackage",
    "OverlayRecord",
    "build_folder",
    "overlay_folder",
    "overlay_prefixes",
    "read_record",
]

Builder = Literal["obk", "colcon"]

FOLDER: Final = ".obk"
"""Of a workspace; all that `obk build` makes is in it."""
RECORD: Final = "overlay.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class BuiltPackage:
    """One package of an overlay."""

    source: str
    """Its folder, seen from the workspace."""
    digest: str
    """Of everything that it was made from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OverlayRecord:
    """What an overlay says of itself, in `overlay.json`."""

    builder: Builder
    python: str
    ros: str
    """The ROS 2 that it was built against."""
    prefixes: tuple[str, ...]
    """Where the packages are installed, `.` for the overlay itself."""
    packages: Mapping[str, BuiltPackage]


def overlay_folder(workspace: Path) -> Path:
    """The overlay of a workspace, whether it is there or not."""
    return workspace / FOLDER / "overlay"


def build_folder(workspace: Path) -> Path:
    """Where the packages are compiled; kept, so that unchanged ones need not be again."""
    return workspace / FOLDER / "build"


def read_record(workspace: Path) -> OverlayRecord | None:
    """What is in the overlay, None if there is none that can be read, or another user's."""
    if is_planted(workspace / FOLDER):
        return None
    try:
        record = json.loads((overlay_folder(workspace) / RECORD).read_bytes())
        import msgspec  # only if there is an overlay, for the start-up time of `obk validate`

        return msgspec.convert(record, OverlayRecord)
    except (OSError, ValueError, RecursionError):
        return None


def overlay_prefixes(workspaces: Iterable[Path]) -> tuple[Path, ...]:
    """The prefixes of the workspaces' overlays, the first workspace's first."""
    found: list[Path] = []
    for workspace in workspaces:
        record = read_record(workspace)
        if record is not None and record.packages:
            found += (
                Path(os.path.normpath(overlay_folder(workspace) / p)) for p in record.prefixes
            )
    return tuple(dict.fromkeys(found))
