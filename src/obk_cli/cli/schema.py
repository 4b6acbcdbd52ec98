"""`obk schema`: the JSON schema of configs, for editors and other checkers."""

import os
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Annotated, Final

import typer

from obk_cli.config.tree import TreeMap
from obk_cli.config.yaml_parser import decode_source, parse_source
from obk_cli.configedit.spelling import components_of, devices_of, sections_of
from obk_cli.diagnostics.source import SourceFile
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.files import resource_folder, unwritable, write_text

__all__ = ["SCHEMA_PATH"]

EXAMPLE = "Example: obk schema > obelisk.schema.json"


def command(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="[DIR]", help="With --install-vscode: the project folder."),
    ] = None,
    install_vscode: Annotated[
        bool,
        typer.Option(
            "--install-vscode",
            help="Write the schema for VS Code to DIR (default: here) and show how to use it.",
        ),
    ] = False,
) -> None:
    """Print the JSON schema (draft 2020-12) of configs, or write it for an editor."""
    path = resource_folder("schema") / "obelisk.schema.json"
    text = path.read_text(encoding="utf-8")
    if install_vscode:
        for line in write_vscode_schema(folder or Path(), text):
            print(line)
        return
    if folder is not None:
        raise MisuseError("DIR is only valid with `--install-vscode`")
    print(text, end="")


SCHEMA_PATH: Final = PurePosixPath(".vscode/obelisk.schema.json")
"""Relative to the folder that the editor opens; generated configs refer to this path."""
_MODELINE: Final = "# yaml-language-server: $schema="
_EXTENSION: Final = "redhat.vscode-yaml"
_SKIPPED_FOLDERS = frozenset({"build", "install", "log", "node_modules", "venv", "__pycache__"})
_LONGEST_CONFIG_BYTES = 1024 * 1024


def write_vscode_schema(folder: Path, schema: str) -> Iterator[str]:
    """Write the schema into `folder/.vscode`; return report lines with the configs that lack the
    line.

    Raises:
        CommandFailedError: the folder does not exist, a link leads out of it, or the schema cannot
            be written.
    """
    if not folder.is_dir():
        raise CommandFailedError(f"`{folder}` is not a folder")
    path = folder / SCHEMA_PATH
    real = Path(os.path.realpath(path))
    if not real.is_relative_to(os.path.realpath(folder)):
        raise CommandFailedError(f"`{path}` is a link to {real}, which is outside the folder")
    try:
        is_changed = write_text(path, schema)
    except OSError as error:
        raise unwritable(path, error) from error
    yield f"{path}: {'written' if is_changed else 'nothing to change'}"
    missing = [config for config, has_line in _configs(folder).items() if not has_line]
    if missing:
        yield "to have the editor check these files, add this first line to each:"
    for config in missing:
        yield f"  {config}: {_MODELINE}{_path_from(config)}"
    yield f"VS Code needs the {_EXTENSION} extension for this"


def _path_from(config: str) -> str:
    """The schema's path, relative to a config."""
    return "../" * config.count("/") + str(SCHEMA_PATH)


def _configs(folder: Path) -> dict[str, bool]:
    """Configs and config fragments in the folder -> whether each has the schema line."""
    found: dict[str, bool] = {}
    for root, folders, names in os.walk(folder):
        folders[:] = sorted(
            name for name in folders if name not in _SKIPPED_FOLDERS and not name.startswith(".")
        )
        for path in (Path(root, name) for name in sorted(names)):
            source = _read(path) if path.suffix in (".yaml", ".yml") else None
            if source is not None and _is_config(source):
                has_line = any(line.startswith(_MODELINE) for line in source.lines)
                found[path.relative_to(folder).as_posix()] = has_line
    return found


def _read(path: Path) -> SourceFile | None:
    try:
        # Reading a pipe or a device might never return.
        if not path.is_file() or path.stat().st_size > _LONGEST_CONFIG_BYTES:
            return None
        source = decode_source(str(path), path.read_bytes())
    except OSError:
        return None
    return source if isinstance(source, SourceFile) else None


def _is_config(source: SourceFile) -> bool:
    """Whether the text defines nodes with components, or includes a file that may."""
    tree = parse_source(source).tree
    if not isinstance(tree, TreeMap):
        return False
    keys = {entry.key for entry in tree}
    has_sections = bool(devices_of(tree) or sections_of(tree))
    return (has_sections and next(components_of(tree), None) is not None) or {
        "config",
        "include",
    } <= keys
