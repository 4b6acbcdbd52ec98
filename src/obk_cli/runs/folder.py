"""Run folders: where a run keeps its logs and describes itself for other terminals.

`<state folder>/obk/runs/<config>_<date>_<time>/` contains `run.json` (what runs, its PID, plan and
versions, how it ended), `events.jsonl`, `launch.log` (what the terminal showed), one log per node
and, while it runs, `control.sock`.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import msgspec

from obelisk_recordings.find import config_of, folder_of_runs, run_folders, run_name
from obk_cli.errors import CommandFailedError
from obk_cli.plan.plan import Plan, PlannedNode

__all__ = [
    "WRITABLE_HOME",
    "Run",
    "RunOrigin",
    "config_of",
    "make_run_folder",
    "plan_of_run",
    "read_record",
    "read_run",
    "record_end",
    "run_folders",
    "runs_folder",
    "topics_of_run",
    "write_run",
]

RUN_FILE: Final = "run.json"
LONGEST_RUN_FILE: Final = 1 << 23
"""Enough for a stack of hundreds of nodes, with its plan [bytes]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """Description of a run for other terminals."""

    name: str
    pid: int
    """Process ID of the launcher."""
    started: float
    """When the launcher started [s since boot]; differs if its PID is reused."""
    domain: int
    config: str
    nodes: tuple[str, ...]
    """Full names of the nodes with a lifecycle that run here, in bring-up order."""
    other_nodes: tuple[str, ...] = ()
    """Full names of the nodes without a lifecycle."""
    devices: tuple[str, ...] = ()
    """The devices that this launcher runs; empty: all devices of the config."""
    leads: bool = True
    """Whether this launcher controls the stack as a whole, including other devices' nodes."""
    boot: str = ""
    """The boot to which `started` refers; filled in when the run is claimed."""
    ended: float | None = None
    """When the run ended [s since 1970]; None if it is running or its launcher was killed."""
    exit_code: int | None = None
    """The launcher's exit code, once the run has ended."""
    cause: str = ""
    """The first failure; empty if there was none."""

    @property
    def all_nodes(self) -> tuple[str, ...]:
        """Full names of all nodes."""
        return (*self.nodes, *self.other_nodes)


_RUN_DECODER: Final = msgspec.json.Decoder(Run)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOrigin:
    """What a run was made from."""

    plan: str
    """The compiled config, as `emit_plan` writes it."""
    versions: Mapping[str, str]
    """Program or library -> version."""

    @property
    def plan_sha256(self) -> str:
        """Hash of the plan's text; equal for equal compiled configs."""
        import hashlib  # only here: commands that only read runs start faster without it

        return hashlib.sha256(self.plan.encode()).hexdigest()


def runs_folder(environment: Mapping[str, str]) -> Path:
    """The folder of all runs: under OBK_HOME, otherwise ROS_LOG_DIR or the user's state folder.

    Raises:
        CommandFailedError: the user has no home directory.
    """
    folder = folder_of_runs(environment)
    if folder is None:
        raise CommandFailedError(
            "no folder for runs: this user has no home directory", help="set HOME, or OBK_HOME"
        )
    return folder


WRITABLE_HOME: Final = "set OBK_HOME to a writable folder"
"""The help for a run folder that cannot be created."""


def make_run_folder(parent: Path, name: str, now: datetime) -> Path:
    """Create the folder of a new run, accessible only to its owner.

    Raises:
        OSError: the folder cannot be created.
    """
    parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    stem = run_name(name, now)
    for suffix in ("", *(f"_{n}" for n in range(2, 100))):
        try:
            (parent / f"{stem}{suffix}").mkdir(mode=0o700)
        except FileExistsError:
            continue
        return parent / f"{stem}{suffix}"
    raise FileExistsError(f"{parent / stem}: 99 runs were started within this second")


def write_run(folder: Path, run: Run, made_from: RunOrigin | None = None) -> None:
    """Write a run's `run.json`, whole or not at all; an existing `made_from` is kept.

    Raises:
        OSError: the file cannot be written.
    """
    record = {**read_record(folder), **asdict(run)}
    if made_from is not None:
        record["versions"] = dict(made_from.versions)
        record["plan_sha256"] = made_from.plan_sha256
        record["plan"] = json.loads(made_from.plan)
    temporary = folder / f".{RUN_FILE}"
    try:
        temporary.touch(mode=0o600)
        temporary.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        temporary.replace(folder / RUN_FILE)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def record_end(
    folder: Path, run: Run, now_s: float, exit_code: int | None = None, cause: str = ""
) -> None:
    """Record how a run ended, in addition to the content of its `run.json`.

    Args:
        folder: the folder of the run.
        run: as claimed; used if its `run.json` cannot be read.
        now_s: the time [s since 1970].
        exit_code: the launcher's; None if it failed before it had one.
        cause: the first failure.

    Raises:
        OSError: the file cannot be written.
    """
    claimed = read_run(folder) or run
    write_run(folder, replace(claimed, ended=now_s, exit_code=exit_code, cause=cause))


def read_run(folder: Path) -> Run | None:
    """The run described by a folder's `run.json`; None if it cannot be read or shown."""
    try:
        run = _decoded(_read(folder))
    except (ValueError, RecursionError):
        return None
    return run if all(map(str.isprintable, (run.name, *run.all_nodes))) else None


def _decoded(data: bytes) -> Run:
    try:
        return _RUN_DECODER.decode(data)  # it skips the plan, which is most of the file
    except msgspec.DecodeError:
        # It also rejects the unpaired surrogates of paths that are not UTF-8; `json` does not.
        return msgspec.convert(json.loads(data), Run)


def read_record(folder: Path) -> Mapping[str, Any]:
    """The content of a run folder's `run.json`; empty if it cannot be read."""
    try:
        data = json.loads(_read(folder))
    except (ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


def _read(folder: Path) -> bytes:
    """A folder's `run.json`; empty if it cannot be read."""
    path = folder / RUN_FILE
    try:
        # Reading a pipe would never end; a longer file is not from `obk`.
        if not path.is_file() or path.stat().st_size > LONGEST_RUN_FILE:
            return b""
        return path.read_bytes()
    except OSError:
        return b""


_Scalar = bool | int | float | str


@dataclass(frozen=True, slots=True, kw_only=True)
class _KeptNode(PlannedNode):
    """A node whose parameters have a type that can be checked: one kind of list, not four."""

    parameters: Mapping[str, _Scalar | tuple[_Scalar, ...]] = field(  # type: ignore[assignment]
        default_factory=dict
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _KeptPlan:
    name: str
    processes: tuple[_KeptNode, ...]


def topics_of_run(folder: Path) -> Mapping[str, str | None]:
    """The topics of a run's plan with the known types, read from its folder."""
    found: dict[str, str | None] = {}
    for node in plan_of_run(folder).nodes:
        for end in (*node.publishes, *node.subscribes):
            found[end.topic] = found.get(end.topic) or end.msg_type
    return found


def plan_of_run(folder: Path) -> Plan:
    """A run's plan; empty if its folder contains none that can be read.

    Parameters that JSON cannot represent are strings, as in `emit_plan`: `.inf`, `.nan`.
    """
    try:
        kept = msgspec.convert(read_record(folder).get("plan"), _KeptPlan)
    except (ValueError, RecursionError):
        return Plan(name="", nodes=())
    return Plan(name=kept.name, nodes=tuple(map(_node, kept.processes)))


def _node(kept: _KeptNode) -> PlannedNode:
    return PlannedNode(**{field.name: getattr(kept, field.name) for field in fields(kept)})
