"""The facts of models that did not change since they were read, kept in the user's cache folder.

Loading MuJoCo takes longer than everything else that a check does. An entry is JSON under a hash of
MuJoCo's version and of the content of every file of the model; one that cannot be read or written
counts as not there.
"""

import contextlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path

from obelisk_spec.model import ModelFacts, SensorFact
from obk_cli.config.environment import ModelFault, ModelRead
from obk_cli.optional_deps import distribution_version
from obk_cli.workspace.model_reader import missing_files, mjcf_files, read_model_bounded

__all__ = ["cache_folder", "read_model_once"]

_FORMAT = 5
_MOST_ENTRIES = 256
_OTHER_FILES = (b"<attach", b"<model", b"<robot")
"""What may bring further files along; such models are always read."""


def cache_folder(environment: Mapping[str, str]) -> Path | None:
    """Where entries are kept, None where the user has no place for them."""
    home = environment.get("HOME", "")
    given = environment.get("XDG_CACHE_HOME", "")
    if not given and not (home and Path(home).is_dir()):
        return None
    return Path(given or f"{home}/.cache") / "obelisk" / "models"


def read_model_once(path: Path, folder: Path | None) -> ModelRead | ModelFault:
    """The facts of a model; `folder` is the cache, None for none.

    Raises:
        ImportError: MuJoCo is not installed.
    """
    key = None if folder is None else _key(path)
    if folder is None or key is None:
        return read_model_bounded(path)
    entry = folder / f"{key}.json"
    known = _read_entry(entry)
    if known is not None:
        facts, referenced, was_compiled = known
        missing = missing_files(referenced, path)
        if missing or was_compiled:
            return ModelRead(facts=facts, referenced_files=referenced, missing_files=missing)
    read = read_model_bounded(path)
    if isinstance(read, ModelRead) and read.fault is None:
        _write_entry(entry, read)
    return read


def _key(path: Path) -> str | None:
    """The hash of all that the facts come from, None where that is not known."""
    digests = []
    try:
        for file in mjcf_files(path):
            if not file.is_file():  # a pipe or a device might never end
                return None
            data = file.read_bytes()
            if any(mark in data for mark in _OTHER_FILES):
                return None
            digests.append((str(file), sha256(data).hexdigest()))
    except OSError:
        return None
    version = distribution_version("mujoco")
    if version is None:
        return None
    return sha256(json.dumps([_FORMAT, version, str(path), digests]).encode()).hexdigest()


def _read_entry(entry: Path) -> tuple[ModelFacts, tuple[tuple[str, str], ...], bool] | None:
    """Facts, referenced files, and whether all of those were there and the model compiled."""
    try:
        held = json.loads(entry.read_text(encoding="utf-8"))
        facts = held["facts"]
        sensors = {name: SensorFact(**sensor) for name, sensor in facts["sensors"].items()}
        names = {key: tuple(facts[key]) for key in ("bodies", "sites", "cameras", "keyframes")}
        referenced = tuple((str(file), str(written)) for file, written in held["referenced_files"])
        whole = ModelFacts(**{**facts, **names, "sensors": sensors})
        return whole, referenced, bool(held["was_compiled"])
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None


def _write_entry(entry: Path, read: ModelRead) -> None:
    text = json.dumps(
        {
            "facts": asdict(read.facts),
            "referenced_files": read.referenced_files,
            "was_compiled": not read.missing_files,
        }
    )
    temporary = entry.with_suffix(f".{os.getpid()}")
    try:
        entry.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(entry)
        _forget_oldest(entry.parent)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink()


def _forget_oldest(folder: Path) -> None:
    entries = sorted(folder.glob("*.json"), key=lambda path: path.stat().st_mtime)
    for old in entries[:-_MOST_ENTRIES]:
        old.unlink(missing_ok=True)
