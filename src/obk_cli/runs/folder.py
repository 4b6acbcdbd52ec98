"""Run folders: where a run keeps its logs and records what it is, for other terminals.

`<state folder>/obk/runs/<config>_<date>_<time>/` with `run.json` (what runs, under which pid, from
which plan and versions, how it ended), `events.jsonl`, `launch.log` (what the terminal showed), one
log a node, and while it runs `control.sock`.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import msgspec

from obelisk_recordings.find import config_of, folder_of_runs, run_folders
from obk_cli.errors import CommandFailedError
from obk_cli.plan.plan import Plan, PlannedNode

__all__ = [
    "Run",
    "RunOrigin",
    "config_of",
    "make_run_folder",
    "plan_of_run",
    "read_record",
    "read_run",
    "read_runs",
    "record_end",
    "run_folders",
    "runs_folder",
    "topics_of_run",
    "write_run",
]

RUN_FILE: Final = "run.json"
LONGEST_RUN_FILE: Final = 1 << 23
"""A stack of hundreds of nodes, with its plan [bytes]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What another terminal needs to know about a run."""

    name: str
    pid: int
    """Of the launcher."""
    started: float
    """When the launcher's process started [s since boot]: a reused pid has another start."""
    domain: int
    config: str
    nodes: tuple[str, ...]
    """Full names of the nodes with a life cycle that run here, in bring-up order."""
    other_nodes: tuple[str, ...] = ()
    """Full names of those without one."""
    devices: tuple[str, ...] = ()
    """Those that this launcher runs; empty: all of the config."""
    leads: bool = True
    """Whether this launcher drives the stack as a whole, other devices' nodes too."""
    boot: str = ""
    """Which start of which machine `started` counts from; filled in by the claim."""
    ended: float | None = None
    """When the run came to its end [s since 1970]; None: not yet, or its launcher was killed."""
    exit_code: int | None = None
    """The launcher's, once the run has ended."""
    cause: str = ""
    """What went wrong first; empty while all goes well."""

    @property
    def all_nodes(self) -> tuple[str, ...]:
        """Every node's full name."""
        return (*self.nodes, *self.other_nodes)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOrigin:
    """What a run was made from."""

    plan: str
    """The compiled config, as `emit_plan` writes it."""
    versions: Mapping[str, str]
    """Program or library -> version."""

    @property
    def plan_sha256(self) -> str:
        """The hash of the plan's text: the same for the same compiled config."""
        import hashlib  # only here: commands that only read runs start faster without it

        return hashlib.sha256(self.plan.encode()).hexdigest()


def runs_folder(environment: Mapping[str, str]) -> Path:
    """The folder of all runs: below OBK_HOME, else ROS_LOG_DIR, else the user's state folder.

    Raises:
        CommandFailedError: there is no place for it, since the user has no home.
    """
    folder = folder_of_runs(environment)
    if folder is None:
        raise CommandFailedError(
            "no folder for runs: this user has no home directory", help="set HOME, or OBK_HOME"
        )
    return folder


def make_run_folder(parent: Path, name: str, now: datetime) -> Path:
    """Make the folder of a new run, for its owner only.

    Raises:
        OSError: it cannot be made.
    """
    parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    stem = f"{name.replace('/', '_')}_{now:%Y%m%d_%H%M%S}"
    for suffix in ("", *(f"_{n}" for n in range(2, 100))):
        try:
            (parent / f"{stem}{suffix}").mkdir(mode=0o700)
        except FileExistsError:
            continue
        return parent / f"{stem}{suffix}"
    raise FileExistsError(f"{parent / stem}: 99 runs were started within this second")


def write_run(folder: Path, run: Run, made_from: RunOrigin | None = None) -> None:
    """Write a run's `run.json`, whole or not at all; what it was made from stays once it is there.

    Raises:
        OSError: it cannot be written.
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
    """Record how a run ended, in addition to what its `run.json` holds.

    Args:
        folder: the run's.
        run: as it was claimed; used if its `run.json` cannot be read.
        now_s: the time [s since 1970].
        exit_code: the launcher's; None if it failed before it had one.
        cause: what went wrong first.

    Raises:
        OSError: it cannot be written.
    """
    claimed = read_run(folder) or run
    write_run(folder, replace(claimed, ended=now_s, exit_code=exit_code, cause=cause))


def read_runs(parent: Path) -> tuple[Run, ...]:
    """Every run in the folder, newest first; unreadable ones are left out."""
    return tuple(run for folder in run_folders(parent) if (run := read_run(folder)) is not None)


def read_run(folder: Path) -> Run | None:
    """The run that a folder's `run.json` describes; None if it cannot be read or shown."""
    try:
        run = msgspec.convert(read_record(folder), Run)
    except (ValueError, RecursionError):
        return None
    return run if all(map(str.isprintable, (run.name, *run.all_nodes))) else None


def read_record(folder: Path) -> Mapping[str, Any]:
    """The content of a run folder's `run.json`; empty if it cannot be read."""
    path = folder / RUN_FILE
    try:
        # A pipe would never end; a longer file is not from `obk`.
        if not path.is_file() or path.stat().st_size > LONGEST_RUN_FILE:
            return {}
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


_Scalar = bool | int | float | str


@dataclass(frozen=True, slots=True, kw_only=True)
class _KeptNode(PlannedNode):
    """A node whose parameters are of a type that can be checked: one kind of list, not four."""

    parameters: Mapping[str, _Scalar | tuple[_Scalar, ...]] = field(  # type: ignore[assignment]
        default_factory=dict
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _KeptPlan:
    name: str
    processes: tuple[_KeptNode, ...]


def topics_of_run(folder: Path) -> Mapping[str, str | None]:
    """The topics of a run's plan with the types that it knows, read from what the run keeps."""
    found: dict[str, str | None] = {}
    for node in plan_of_run(folder).nodes:
        for end in (*node.publishes, *node.subscribes):
            found[end.topic] = found.get(end.topic) or end.msg_type
    return found


def plan_of_run(folder: Path) -> Plan:
    """A run's config as compiled; empty if its folder keeps none that can be read.

    Parameters that JSON cannot hold are texts, as `emit_plan` writes them: `.inf`, `.nan`.
    """
    try:
        kept = msgspec.convert(read_record(folder).get("plan"), _KeptPlan)
    except (ValueError, RecursionError):
        return Plan(name="", nodes=())
    return Plan(name=kept.name, nodes=tuple(map(_node, kept.processes)))


def _node(kept: _KeptNode) -> PlannedNode:
    return PlannedNode(**{field.name: getattr(kept, field.name) for field in fields(kept)})
