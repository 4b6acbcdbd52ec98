"""`obk schema --install-vscode`: what VS Code needs to check configs while they are written.

The schema goes into the folder's `.vscode`, `settings.json` associates it with the configs that are
there, `extensions.json` recommends the extension that reads it. Settings and comments that are
there stay.
"""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from obk_cli.config.tree import TreeMap
from obk_cli.config.yaml_parser import decode_source, parse_source
from obk_cli.diagnostics.source import SourceFile
from obk_cli.errors import CommandFailedError
from obk_cli.files import explain_os_error, unwritable, write_text
from obk_cli.jsonc import JsoncError, read_jsonc, set_member
from obk_cli.migrate.shape import components_of, devices_of, sections_of

__all__ = ["install_vscode", "vscode_texts"]

_SCHEMA = "./.vscode/obelisk.schema.json"
"""As the editor finds it from the folder."""
_NEW_CONFIGS = "*.obelisk.yaml"
_EXTENSION = "redhat.vscode-yaml"
_NOT_LOOKED_INTO = frozenset({"build", "install", "log", "node_modules", "venv", "__pycache__"})
_LONGEST_CONFIG_BYTES = 1024 * 1024


def install_vscode(folder: Path, schema: str) -> Iterator[str]:
    """Write the files into `folder/.vscode`; a line for each thing done.

    Raises:
        CommandFailedError: the folder is not there, a link leads out of it, or settings that are
            there cannot be merged; the help says what to add by hand.
    """
    if not folder.is_dir():
        raise CommandFailedError(f"`{folder}` is no folder")
    configs = _configs(folder)
    texts = vscode_texts(folder, schema, configs)
    for path in texts:
        real = Path(os.path.realpath(path))
        if not real.is_relative_to(os.path.realpath(folder)):
            raise CommandFailedError(f"a link leads `{path}` out of the folder, to {real}")
    for path, text in texts.items():
        yield f"{path}: {'written' if _write(path, text) else 'nothing to change'}"
    yield f"checked while you write: {', '.join([*configs, _NEW_CONFIGS])}"


def vscode_texts(folder: Path, schema: str, configs: Iterable[str]) -> dict[Path, str]:
    """What the files in `folder/.vscode` are to hold: what is there, and what these configs need.

    Raises:
        CommandFailedError: settings that are there cannot be merged; the help says what to add.
    """
    home = folder / ".vscode"
    settings, extensions = home / "settings.json", home / "extensions.json"
    return {
        home / "obelisk.schema.json": schema,
        settings: _with_schema(settings, [*configs, _NEW_CONFIGS]),
        extensions: _with_extension(extensions),
    }


def _configs(folder: Path) -> list[str]:
    """The YAML files of the folder that are configs or fragments of one."""
    found: list[str] = []
    for root, folders, names in os.walk(folder):
        folders[:] = sorted(
            name for name in folders if name not in _NOT_LOOKED_INTO and not name.startswith(".")
        )
        paths = (Path(root, name) for name in sorted(names) if name.endswith((".yaml", ".yml")))
        found += [path.relative_to(folder).as_posix() for path in paths if _is_config(path)]
    return found


def _is_config(path: Path) -> bool:
    """Whether the file holds nodes with components, or includes what may."""
    try:
        # A pipe or a device might never end.
        if not path.is_file() or path.stat().st_size > _LONGEST_CONFIG_BYTES:
            return False
        source = decode_source(str(path), path.read_bytes())
    except OSError:
        return False
    tree = parse_source(source).tree if isinstance(source, SourceFile) else None
    if not isinstance(tree, TreeMap):
        return False
    keys = {entry.key for entry in tree}
    has_sections = bool(devices_of(tree) or sections_of(tree))
    return (has_sections and next(components_of(tree), None) is not None) or {
        "config",
        "include",
    } <= keys


def _with_schema(path: Path, globs: list[str]) -> str:
    text = _read(path) or "{}\n"
    try:
        value = read_jsonc(text)
        schemas = value.get("yaml.schemas") if isinstance(value, dict) else None
        listed = _listed(schemas.get(_SCHEMA)) if isinstance(schemas, dict) else []
        if set(globs) <= set(listed):
            return text
        return set_member(text, ("yaml.schemas", _SCHEMA), list(dict.fromkeys([*listed, *globs])))
    except JsoncError as error:
        help = f'add to it by hand: "yaml.schemas": {{"{_SCHEMA}": {_quoted(globs)}}}'
        raise CommandFailedError(f"`{path}` cannot be merged: {error}", help=help) from error


def _with_extension(path: Path) -> str:
    text = _read(path) or "{}\n"
    try:
        value = read_jsonc(text)
        listed = _listed(value.get("recommendations")) if isinstance(value, dict) else []
        if _EXTENSION in listed:
            return text
        return set_member(text, ("recommendations",), [*listed, _EXTENSION])
    except JsoncError as error:
        help = f'add to it by hand: "recommendations": ["{_EXTENSION}"]'
        raise CommandFailedError(f"`{path}` cannot be merged: {error}", help=help) from error


def _listed(value: object) -> list[str]:
    items = value if isinstance(value, list) else [value]
    return [item for item in items if isinstance(item, str)]


def _quoted(globs: list[str]) -> str:
    return f"[{', '.join(f'{chr(34)}{glob}{chr(34)}' for glob in globs)}]"


def _read(path: Path) -> str:
    try:
        return path.read_bytes().decode("utf-8") if path.exists() else ""
    except (OSError, UnicodeDecodeError) as error:
        reason = explain_os_error(error)
        raise CommandFailedError(f"`{path}` cannot be read: {reason}") from error


def _write(path: Path, text: str) -> bool:
    """Put the text there; tells whether anything changed."""
    try:
        return write_text(path, text)
    except OSError as error:
        raise unwritable(path, error) from error
