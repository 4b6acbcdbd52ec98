"""The facts of a MuJoCo model, read by MjSpec: meshes may be missing, and if none is, it compiles.

A path in; facts, or why there are none. MuJoCo is imported when the first model is read, and its
errors end here.
"""

import importlib
import importlib.util
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from obelisk_spec.model import read_model_facts
from obk_cli.config.environment import ModelFault, ModelRead

__all__ = ["has_mujoco", "import_mujoco", "missing_files", "read_model"]

_LINE = re.compile(r"[Ll]ine(?: number)?[ =]+(\d+)")
_NOT_XML = re.compile(r"Error=XML_ERROR_(\w+).*XMLElement name=(\w*)", re.DOTALL)
_NOISE = re.compile(r"^(XML Error|Error|ParseXML): *")


def has_mujoco() -> bool:
    """Whether MuJoCo is installed; does not import it."""
    return importlib.util.find_spec("mujoco") is not None


def read_model(path: Path) -> ModelRead | ModelFault:
    """The facts of a model file.

    Raises:
        ImportError: MuJoCo is not installed; ask `has_mujoco` first.
    """
    mujoco = import_mujoco()
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, mujoco.FatalError) as error:
        return _fault(str(error))
    wanted = _wanted_files(spec, path)
    facts = read_model_facts(spec)
    missing = missing_files(wanted, path)
    return ModelRead(
        facts=facts,
        wanted_files=wanted,
        missing_files=missing,
        fault=None if missing else _compile_fault(spec),
    )


def _compile_fault(spec: Any) -> ModelFault | None:
    """What is wrong with a model that could be read: only now the names in it are looked up."""
    try:
        spec.compile()
    except (ValueError, import_mujoco().FatalError) as error:
        return _fault(str(error))
    return None


def import_mujoco() -> Any:
    """MuJoCo without its window system, whose search for libraries takes longer than the model."""
    chosen = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disable"
    try:
        return importlib.import_module("mujoco")
    finally:
        if chosen is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = chosen


def _fault(text: str) -> ModelFault:
    line = _LINE.search(text)
    not_xml = _NOT_XML.search(text)
    if not_xml is not None:
        text = f"not XML: {not_xml[1].lower().replace('_', ' ')} (`{not_xml[2]}`)"
    sentence = "; ".join(part.strip() for part in text.strip().splitlines() if part.strip())
    return ModelFault(message=_NOISE.sub("", sentence), line=int(line[1]) if line else None)


def _wanted_files(spec: Any, path: Path) -> tuple[tuple[str, str], ...]:
    """Meshes and textures: under their folder, and as written."""
    compiler = spec.compiler
    folders = ((spec.meshes, compiler.meshdir), (spec.textures, compiler.texturedir))
    wanted = ((folder, e.file) for elements, folder in folders for e in elements if e.file)
    # A file of an included model comes with its folder in front, its `meshdir` not yet applied.
    return tuple(
        (
            str(Path(folder) / os.path.relpath(file, path.parent))
            if Path(file).is_absolute()
            else str(Path(folder) / file),
            file,
        )
        for folder, file in wanted
    )


def missing_files(wanted: Iterable[tuple[str, str]], path: Path) -> tuple[str, ...]:
    """The files that are in neither place, of those that the model at `path` wants."""
    folder = path.parent
    return tuple(
        dict.fromkeys(
            relative
            for relative, written in wanted
            # `Path.is_file` raises at a name that no file can have, and in a closed folder. A pipe
            # is no file: MuJoCo would wait for it.
            if not os.path.isfile(folder / written)  # noqa: PTH113
            and not os.path.isfile(folder / relative)  # noqa: PTH113
        )
    )
