"""Run folders: where a run keeps its logs and tells other terminals what it is.

`<state folder>/obk/runs/<config>_<date>_<time>/` with `run.json` (what runs, under which pid, from
which plan and versions, how it ended), `events.jsonl`, `launch.log` (what the terminal showed), one
log a node, and while it runs `control.sock`.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from obk_cli.errors import CommandFailedError
from obk_cli.launch.json_values import value_of

if TYPE_CHECKING:
    from obk_cli.launch.events import Ended

__all__ = [
    "MadeFrom",
    "Run",
    "config_of",
    "make_run_folder",
    "note_end",
    "read_run",
    "read_runs",
    "read_told",
    "run_folders",
    "runs_folder",
    "write_run",
]

RUN_FILE: Final = "run.json"
LONGEST_RUN_FILE: Final = 1 << 23
"""A stack of hundreds of nodes, with its plan [bytes]."""
_FOLDER_NAME: Final = re.compile(r"(?P<config>.+)_(?P<stamp>\d{8}_\d{6})(?:_(?P<suffix>\d+))?")


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What another terminal needs to know of a run."""

    name: str
    pid: int
    """Of the launcher."""
    started: float
    """When the launcher's process started [s since boot], so that a reused pid is told apart."""
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
class MadeFrom:
    """What a run was made from, for whoever looks at it later."""

    plan: str
    """The compiled config, as `emit_plan` writes it."""
    versions: Mapping[str, str]
    """Program or library -> version."""

    @property
    def plan_sha256(self) -> str:
        """The hash of the plan's text: the same for the same compiled config."""
        import hashlib  # for this alone; who only reads runs is quicker without

        return hashlib.sha256(self.plan.encode()).hexdigest()


def runs_folder(environment: Mapping[str, str]) -> Path:
    """The folder of all runs: below OBK_HOME, else ROS_LOG_DIR, else the user's state folder.

    Raises:
        CommandFailedError: nothing tells where that is.
    """
    home = environment.get("OBK_HOME")
    logs = environment.get("ROS_LOG_DIR")
    if home:
        return Path(home) / "runs"
    if logs:
        return Path(logs) / "obk" / "runs"

    from platformdirs import user_state_path  # only where nothing else says

    try:
        return user_state_path("obk") / "runs"
    except RuntimeError as error:
        raise CommandFailedError(
            "there is no folder for runs: this user has no home", help="set HOME, or OBK_HOME"
        ) from error


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
    raise FileExistsError(f"{parent / stem}: there are 99 runs of this second")


def write_run(folder: Path, run: Run, made_from: MadeFrom | None = None) -> None:
    """Write a run's `run.json`, whole or not at all; what it was made from stays once it is there.

    Raises:
        OSError: it cannot be written.
    """
    told = {**read_told(folder), **asdict(run)}
    if made_from is not None:
        told["versions"] = dict(made_from.versions)
        told["plan_sha256"] = made_from.plan_sha256
        told["plan"] = json.loads(made_from.plan)
    temporary = folder / f".{RUN_FILE}"
    try:
        temporary.touch(mode=0o600)
        temporary.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
        temporary.replace(folder / RUN_FILE)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def note_end(folder: Path, run: Run, ended: "Ended | None", now_s: float) -> None:
    """Write how a run ended, beside what is known of it.

    Args:
        folder: the run's.
        run: as it was claimed.
        ended: the launcher's own word; None where it had none, for it failed otherwise.
        now_s: the time [s since 1970].

    Raises:
        OSError: it cannot be written.
    """
    exit_code, cause = (ended.exit_code, ended.cause) if ended else (None, "")
    claimed = read_run(folder) or run
    write_run(folder, replace(claimed, ended=now_s, exit_code=exit_code, cause=cause))


def read_runs(parent: Path) -> tuple[Run, ...]:
    """Every run that is told of in the folder, newest first; unreadable ones are left out."""
    return tuple(run for folder in run_folders(parent) if (run := read_run(folder)) is not None)


def run_folders(parent: Path) -> tuple[Path, ...]:
    """The folders of all runs, newest first; what is not named like one is left out.

    In a folder that is closed to this user there are none.
    """
    try:
        found = list(parent.glob("*/"))
    except PermissionError:
        return ()
    named = ((path, _FOLDER_NAME.fullmatch(path.name)) for path in found)
    dated = [(m["stamp"], int(m["suffix"] or 0), path) for path, m in named if m]
    return tuple(path for _, _, path in sorted(dated, reverse=True))


def config_of(folder: Path) -> str:
    """The config's name in a run folder's; a slash in it is an underscore here."""
    match = _FOLDER_NAME.fullmatch(folder.name)
    return match["config"] if match else folder.name


def read_run(folder: Path) -> Run | None:
    """What a run folder's `run.json` tells; None where it cannot be read."""
    run = value_of(Run, read_told(folder))
    is_shown = run is not None and all(map(str.isprintable, (run.name, *run.all_nodes)))
    return run if is_shown else None


def read_told(folder: Path) -> Mapping[str, Any]:
    """All that a run folder's `run.json` tells; empty where it cannot be read."""
    path = folder / RUN_FILE
    try:
        # A pipe would never end, and what is longer is none of ours.
        if not path.is_file() or path.stat().st_size > LONGEST_RUN_FILE:
            return {}
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}
