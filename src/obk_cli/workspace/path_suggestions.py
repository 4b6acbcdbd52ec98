"""Configs that the path of none may stand for: files of its folder, else of the workspace.

In: a path as the user wrote it. Out: a help line. Goes by names; no file is opened.
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from obelisk_spec.suggestions import list_names, near_names
from obk_cli.config.environment import UNSEARCHED
from obk_cli.files import STANDARD_INPUT
from obk_cli.workspace.package_index import find_workspace

__all__ = ["did_you_mean_config"]

_SUFFIXES: Final = (".yaml", ".yml")
_DEEPEST: Final = 3
"""Folders below the workspace in which a config may lie."""
_MOST: Final = 1_000
"""Configs of a workspace that are looked at."""


def did_you_mean_config(path: str) -> str | None:
    """What may be meant by a path where nothing is; None where something is, or nothing is near."""
    written = Path(path)
    if path == STANDARD_INPUT or not written.name or os.path.lexists(written):
        return None
    here = Path.cwd()
    beside = sorted(_configs_in(written.parent, 0))
    near = _near(written, beside)
    near = near or _near(written, sorted(_configs_in(find_workspace(here), _DEEPEST)))
    if near:
        shown = (_from(here, config) for config in near)
        return f"did you mean {' or '.join(f'`{name}`' for name in shown)}?"
    return f"there is: {list_names(map(str, beside))}" if beside else None


def _near(written: Path, configs: list[Path]) -> list[Path]:
    """The configs whose names, without their endings, are near."""
    stems = near_names(written.stem, {config.stem for config in configs})
    return [config for stem in stems for config in configs if config.stem == stem]


def _configs_in(folder: Path, deepest: int) -> Iterator[Path]:
    """At most so many YAML files in a folder, and in those below it."""
    found = 0
    for parent, folders, names in os.walk(folder):
        depth = len(Path(parent).parts) - len(folder.parts)
        is_deep = depth >= deepest
        folders[:] = [] if is_deep else [f for f in folders if f[0] != "." and f not in UNSEARCHED]
        for name in names:
            if name.endswith(_SUFFIXES) and not name.startswith("."):
                found += 1
                if found > _MOST:
                    return
                yield Path(parent, name)


def _from(here: Path, config: Path) -> str:
    """The path as one would type it."""
    return str(config.relative_to(here) if config.is_relative_to(here) else config)
