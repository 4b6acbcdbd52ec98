"""Read facts about a MuJoCo model with MjSpec. Meshes may be missing; otherwise it is compiled.

The result is the facts, or why they cannot be read. MuJoCo is imported for the first model, and
its errors are converted here.

Loading MuJoCo takes longer than the rest of a check, so the facts about unchanged models are kept
in the user's cache folder. An entry is JSON, named after a hash of MuJoCo's version and the content
of all files of the model. An entry that cannot be read or written counts as missing.
"""

import contextlib
import faulthandler
import importlib
import importlib.util
import json
import os
import re
import resource
import signal
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, NoReturn
from xml.parsers import expat

from obelisk_spec.model import ActuatorFact, ModelFacts, SensorFact, read_model_facts
from obk_cli.config.environment import ModelFault, ModelRead
from obk_cli.optional_deps import distribution_version

__all__ = [
    "MjcfElement",
    "cache_folder",
    "has_mujoco",
    "import_mujoco",
    "missing_files",
    "mjcf_elements",
    "mjcf_files",
    "read_model",
    "read_model_bounded",
    "read_model_once",
]


_SENSOR_SECTION = "sensor"
_FORMAT = 7
_MOST_ENTRIES = 256
_OTHER_FILES = (b"<attach", b"<model", b"<robot")
"""Elements that may refer to further files; such models are always read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MjcfElement:
    """One named element; line and column of its `<`, from 1."""

    kind: str
    """`sensor` for every sensor type, otherwise the tag."""
    name: str
    path: Path
    line: int
    column: int


def mjcf_elements(path: Path) -> Iterator[MjcfElement]:
    """The named elements and options of a model, in the order of its files.

    A file that is missing or not well-formed XML is skipped without a finding: loading the model
    reports it.
    """
    for scan in _scans(path, lambda scan: scan.includes):
        yield from scan.found


def mjcf_files(path: Path) -> Iterator[Path]:
    """The files of a model: its own, and those that it includes or attaches, even missing ones."""
    for scan in _scans(path, lambda scan: [*scan.includes, *scan.attached]):
        yield scan.path


def _scans(path: Path, named: Callable[["_Scan"], list[Path]]) -> Iterator["_Scan"]:
    """A model's files, each once, however often it is referred to."""
    waiting = [path]
    seen: set[str] = set()
    while waiting:
        file = waiting.pop()
        real = os.path.realpath(file)
        if real not in seen:
            seen.add(real)
            scan = _Scan(file, path.parent)
            yield scan
            waiting += reversed(named(scan))


class _Scan:
    """Scans one file, up to its end or its first fault."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.path = path
        self.found: list[MjcfElement] = []
        self.includes: list[Path] = []
        self.attached: list[Path] = []
        """Other models of which this one uses parts."""
        self._folder = folder
        self._open: list[str] = []
        # Like MuJoCo, ignore the encoding that the file declares.
        self._parser = expat.ParserCreate("utf-8")
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = lambda _: self._open.pop()
        with contextlib.suppress(OSError, expat.ExpatError):
            if path.is_file():  # reading a pipe or a device might never return
                self._parser.Parse(path.read_bytes(), True)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        parent = self._open[-1] if self._open else ""
        self._open.append(tag)
        if tag == "include" and "file" in attributes:
            self.includes.append(self._folder / attributes["file"])
        elif tag == "model" and "file" in attributes:
            self.attached.append(self._folder / attributes["file"])
        if "name" not in attributes and tag != "option":
            return
        element = MjcfElement(
            kind=_SENSOR_SECTION if parent == _SENSOR_SECTION else tag,
            name=attributes.get("name", ""),
            path=self.path,
            line=self._parser.CurrentLineNumber,
            column=self._parser.CurrentColumnNumber + 1,
        )
        self.found.append(element)


_LINE = re.compile(r"[Ll]ine(?: number)?[ =]+(\d+)")
_NOT_XML = re.compile(r"Error=XML_ERROR_(\w+).*XMLElement name=(\w*)", re.DOTALL)
_NOISE = re.compile(r"^(XML Error|Error|ParseXML): *")
_NO_MESSAGE: Final = "MuJoCo rejects it without a message, as it does for a name that is not UTF-8"


def has_mujoco() -> bool:
    """Whether MuJoCo is installed; does not import it."""
    return importlib.util.find_spec("mujoco") is not None


def read_model(path: Path) -> ModelRead | ModelFault:
    """Read the facts about a model.

    Raises:
        ImportError: MuJoCo is not installed; check `has_mujoco` first.
    """
    mujoco = import_mujoco()
    try:
        spec = mujoco.MjSpec.from_file(os.fsencode(path))  # the bytes, in any locale
    except (ValueError, mujoco.FatalError) as error:
        return _fault(error)
    referenced = _referenced_files(spec, path)
    facts = read_model_facts(spec)
    missing = missing_files(referenced, path)
    if missing and _has_odd_file(referenced, path):
        return ModelRead(facts=facts, referenced_files=referenced, missing_files=missing)
    fault = _compile_fault(spec)
    # A file of an attached model is in that model's folder: if the model compiles, none is missing.
    is_without = bool(missing) and fault is not None
    return ModelRead(
        facts=facts,
        referenced_files=referenced,
        missing_files=missing if is_without else (),
        fault=None if is_without else fault,
    )


def _has_odd_file(referenced: Iterable[tuple[str, str]], path: Path) -> bool:
    """Whether compiling the model would open a pipe or a device, and wait for it."""
    folders = {file.parent for file in mjcf_files(path)}
    return any(
        _is_odd(folder / name) for names in referenced for name in names for folder in folders
    )


def _compile_fault(spec: Any) -> ModelFault | None:
    """Why a readable model cannot be compiled; only compiling looks up the names in it."""
    try:
        spec.compile()
    except (ValueError, import_mujoco().FatalError) as error:
        return _fault(error)
    return None


def import_mujoco() -> Any:
    """Import MuJoCo without its window system, which searches slowly for libraries."""
    chosen = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disable"
    try:
        return importlib.import_module("mujoco")
    finally:
        if chosen is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = chosen


def _fault(error: Exception) -> ModelFault:
    # MuJoCo quotes names byte by byte. If they are not UTF-8, its message becomes this exception,
    # or is lost, depending on the Python version.
    if isinstance(error, UnicodeDecodeError):
        text = error.object.decode(errors="replace")
    else:
        text = str(error) or _NO_MESSAGE
    line = _LINE.search(text)
    not_xml = _NOT_XML.search(text)
    if not_xml is not None:
        text = f"not well-formed XML: {not_xml[1].lower().replace('_', ' ')} (`{not_xml[2]}`)"
    sentence = "; ".join(part.strip() for part in text.strip().splitlines() if part.strip())
    return ModelFault(message=_NOISE.sub("", sentence), line=int(line[1]) if line else None)


def _referenced_files(spec: Any, path: Path) -> tuple[tuple[str, str], ...]:
    """Meshes, height fields, skins and textures: path below their folder, and as written."""
    compiler = spec.compiler
    shapes = (element.file for element in (*spec.meshes, *spec.hfields, *spec.skins))
    images = (file for texture in spec.textures for file in (texture.file, *texture.cubefiles))
    named = ((compiler.meshdir, shapes), (compiler.texturedir, images))
    referenced = ((folder, file) for folder, files in named for file in files if file)
    # A file of an included model is prefixed with its folder, but its `meshdir` is not applied yet.
    return tuple(
        (
            str(Path(folder) / os.path.relpath(file, path.parent))
            if Path(file).is_absolute()
            else str(Path(folder) / file),
            file,
        )
        for folder, file in referenced
    )


def missing_files(referenced: Iterable[tuple[str, str]], path: Path) -> tuple[str, ...]:
    """The files that the model at `path` refers to but that are in neither location."""
    folder = path.parent
    return tuple(
        dict.fromkeys(
            relative
            for relative, written in referenced
            # `Path.is_file` raises for invalid names and in unreadable folders. A pipe is not a
            # file, because MuJoCo would wait for it.
            if not os.path.isfile(folder / written)  # noqa: PTH113
            and not os.path.isfile(folder / relative)  # noqa: PTH113
        )
    )


_CPU_S: Final = 60
_DEADLINE_S: Final = 300
"""Limit for the process [s]; on a busy machine it may wait for processor time."""
_MEMORY_BYTES: Final = 4 * 1024**3


def read_model_bounded(path: Path) -> ModelRead | ModelFault:
    """Like `read_model`, but safe against files that hang or crash the process.

    Raises:
        ImportError: MuJoCo is not installed; check `has_mujoco` first.
    """
    odd = next(filter(_is_odd, mjcf_files(path)), None)
    if odd is not None:
        return ModelFault(message=f"`{odd}` is not a regular file")
    import_mujoco()
    here, there = os.pipe()
    with warnings.catch_warnings():
        # Threads of this process do not affect a child that touches nothing of theirs.
        warnings.simplefilter("ignore", DeprecationWarning)
        pid = os.fork()
    if pid == 0:
        _answer(path, there)
    os.close(there)
    with os.fdopen(here, "rb") as pipe:
        output = pipe.read()
    _, status = os.waitpid(pid, 0)
    return _read_answer(output) or ModelFault(message=_end_of(os.waitstatus_to_exitcode(status)))


def _is_odd(path: Path) -> bool:
    """Whether it exists and is not a regular file: MuJoCo would wait for a pipe."""
    # The methods of `Path` raise for invalid names.
    return os.path.exists(path) and not os.path.isfile(path)  # noqa: PTH110, PTH113


def _read_answer(output: bytes) -> ModelRead | ModelFault | None:
    import msgspec  # only here: a cached model needs no process

    try:
        data = json.loads(output)
        kind: type[ModelRead | ModelFault] = ModelFault if "message" in data else ModelRead
        return msgspec.convert(data, kind)
    except ValueError:  # the process ended before it could answer
        return None


def _end_of(exit_code: int) -> str:
    if exit_code == -signal.SIGXCPU:
        return f"MuJoCo needs more than {_CPU_S} s of CPU time to read it"
    if exit_code == -signal.SIGALRM:
        return f"MuJoCo did not read it within {_DEADLINE_S} s"
    how = signal.Signals(-exit_code).name if exit_code < 0 else f"exit code {exit_code}"
    return f"MuJoCo crashed while reading it ({how})"


def _answer(path: Path, pipe: int) -> NoReturn:
    """In the child: read, answer and exit, without touching the parent's resources."""
    try:
        faulthandler.disable()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
            signal.signal(number, signal.SIG_DFL)
        signal.alarm(_DEADLINE_S)
        for what, most in ((resource.RLIMIT_CPU, _CPU_S), (resource.RLIMIT_DATA, _MEMORY_BYTES)):
            _, hard = resource.getrlimit(what)
            bound = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(what, (bound, hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        nowhere = os.open(os.devnull, os.O_RDWR)
        for output in (1, 2):
            os.dup2(nowhere, output)
        # By default, MuJoCo writes warnings to a file in the working directory.
        import_mujoco().set_mju_user_warning(_drop)
        with os.fdopen(pipe, "w", encoding="utf-8") as answer:
            json.dump(asdict(read_model(path)), answer)
        os._exit(0)
    finally:
        os._exit(1)


def _drop(_text: str) -> None:
    """Ignore a warning of MuJoCo."""


def cache_folder(environment: Mapping[str, str]) -> Path | None:
    """The folder for cache entries; None if the user has none."""
    home = environment.get("HOME", "")
    given = environment.get("XDG_CACHE_HOME", "")
    if not given and not (home and Path(home).is_dir()):
        return None
    return Path(given or f"{home}/.cache") / "obelisk" / "models"


def read_model_once(path: Path, folder: Path | None) -> ModelRead | ModelFault:
    """Read the facts about a model, using the cache in `folder`; None for no cache.

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
    """The hash of everything that determines the facts; None if unknown."""
    digests = []
    try:
        for file in mjcf_files(path):
            if not file.is_file():  # reading a pipe or a device might never return
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
    """Facts, referenced files, and whether all files existed and the model compiled."""
    try:
        held = json.loads(entry.read_text(encoding="utf-8"))
        facts = held["facts"]
        sensors = {name: SensorFact(**sensor) for name, sensor in facts["sensors"].items()}
        names = {key: tuple(facts[key]) for key in ("bodies", "sites", "cameras", "keyframes")}
        referenced = tuple((str(file), str(written)) for file, written in held["referenced_files"])
        actuators = tuple(ActuatorFact(**actuator) for actuator in facts["actuators"])
        named = {**names, "sensors": sensors, "actuators": actuators}
        whole = ModelFacts(**{**facts, **named})
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
