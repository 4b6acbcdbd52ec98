"""Find the configs of a workspace that a misspelled path may refer to, or that include a file."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from obelisk_spec.suggestions import list_names, near_names
from obk_cli.config.environment import UNSEARCHED
from obk_cli.config.tree import TreeList, TreeMap, TreeScalar
from obk_cli.config.yaml_parser import decode_source, parse_source
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import LONGEST_FILE_BYTES
from obk_cli.files import STANDARD_INPUT, read_bytes
from obk_cli.workspace.package_index import find_workspace

__all__ = ["configs_that_include", "did_you_mean_config", "similar_configs"]

_SUFFIXES: Final = (".yaml", ".yml")
_CONFIG_DEPTH: Final = 3
"""Maximum depth of a config below the workspace [folders]."""
_MOST: Final = 1_000
"""Maximum number of configs searched in a workspace."""


def did_you_mean_config(path: str) -> str | None:
    """Suggest similar paths for a missing file; None if it exists, or none is similar."""
    near = similar_configs(path)
    if near:
        return f"did you mean {' or '.join(f'`{name}`' for name in near)}?"
    if not _is_missing(path):
        return None
    beside = sorted(_configs_in(Path(path).parent, 0))
    return f"available: {list_names(map(str, beside))}" if beside else None


def similar_configs(path: str) -> tuple[str, ...]:
    """Paths similar to that of a missing file: in its folder, otherwise in the workspace."""
    if not _is_missing(path):
        return ()
    written, here = Path(path), Path.cwd()
    near = _near(written, sorted(_configs_in(written.parent, 0)))
    near = near or _near(written, sorted(_configs_in(find_workspace(here), _CONFIG_DEPTH)))
    return tuple(_from(here, config) for config in near)


def _is_missing(path: str) -> bool:
    return path != STANDARD_INPUT and bool(Path(path).name) and not os.path.lexists(path)


def _near(written: Path, configs: list[Path]) -> list[Path]:
    """The configs with similar names, ignoring file extensions."""
    stems = near_names(written.stem, {config.stem for config in configs})
    return [config for stem in stems for config in configs if config.stem == stem]


def _configs_in(folder: Path, deepest: int) -> Iterator[Path]:
    """YAML files in a folder and its subfolders, up to a limit."""
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
    """The path as a user would type it."""
    return str(config.relative_to(here) if config.is_relative_to(here) else config)


def configs_that_include(path: str) -> tuple[str, ...]:
    """The configs of its workspace that include a file, as paths relative to the current folder."""
    if path == STANDARD_INPUT:
        return ()
    fragment = Path(path).resolve()
    candidates = dict.fromkeys(
        (
            *sorted(_configs_in(fragment.parent, 0)),
            *sorted(_configs_in(find_workspace(fragment.parent), _CONFIG_DEPTH)),
        )
    )
    here = Path.cwd()
    return tuple(_from(here, c) for c in candidates if fragment in _included_by(c, fragment.name))


def _included_by(config: Path, name: str) -> Iterator[Path]:
    """The files that a config itself includes; `name` must occur in the config's text."""
    if not config.is_file() or config.stat().st_size > LONGEST_FILE_BYTES:
        return
    data = read_bytes(str(config))
    if isinstance(data, str) or b"include" not in data or name.encode() not in data:
        return
    source = decode_source(str(config), data)
    tree = None if isinstance(source, Diagnostic) else parse_source(source).tree
    entry = tree.get("include") if isinstance(tree, TreeMap) else None
    if entry is None:
        return
    items = entry.value.items if isinstance(entry.value, TreeList) else (entry.value,)
    for item in items:
        if isinstance(item, TreeScalar) and isinstance(item.value, str):
            yield Path(os.path.realpath(config.parent / item.value))
