"""Run folders: where a run keeps its logs and tells other terminals what it is.

`<state folder>/obk/runs/<config>_<date>_<time>/` with `run.json` (what runs, under which pid),
`events.jsonl`, `launch.log` (what the terminal showed), and one log a node.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Final

from platformdirs import user_state_path

__all__ = [
    "Run",
    "make_run_folder",
    "read_run",
    "read_runs",
    "run_folders",
    "runs_folder",
    "write_run",
]

RUN_FILE: Final = "run.json"
_FOLDER_NAME: Final = re.compile(r".+_(?P<stamp>\d{8}_\d{6})(?:_(?P<suffix>\d+))?")


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
    """Full names of the nodes with a life cycle, in bring-up order."""
    other_nodes: tuple[str, ...] = ()
    """Full names of those without one."""
    ended: float | None = None
    """When the run came to its end [s since 1970]; None: not yet, or its launcher was killed."""

    @property
    def all_nodes(self) -> tuple[str, ...]:
        """Every node's full name."""
        return (*self.nodes, *self.other_nodes)


def runs_folder(environment: Mapping[str, str]) -> Path:
    """The folder of all runs; OBK_HOME moves it."""
    home = environment.get("OBK_HOME")
    return (Path(home) if home else user_state_path("obk")) / "runs"


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


def write_run(folder: Path, run: Run) -> None:
    """Write a run's `run.json`, whole or not at all."""
    temporary = folder / f".{RUN_FILE}"
    temporary.write_text(json.dumps(asdict(run), indent=1) + "\n")
    temporary.replace(folder / RUN_FILE)


def read_runs(parent: Path) -> tuple[Run, ...]:
    """Every run that is told of in the folder, newest first; unreadable ones are left out."""
    return tuple(run for folder in run_folders(parent) if (run := read_run(folder)) is not None)


def run_folders(parent: Path) -> tuple[Path, ...]:
    """The folders of all runs, newest first; what is not named like one is left out."""
    named = ((path, _FOLDER_NAME.fullmatch(path.name)) for path in parent.glob("*/"))
    dated = [(m["stamp"], int(m["suffix"] or 0), path) for path, m in named if m]
    return tuple(path for _, _, path in sorted(dated, reverse=True))


def read_run(folder: Path) -> Run | None:
    """What a run folder's `run.json` tells; None where it cannot be read."""
    try:
        data = json.loads((folder / RUN_FILE).read_text())
        lists = {key: tuple(data.get(key, ())) for key in ("nodes", "other_nodes")}
        return Run(**{**data, **lists})
    except (OSError, ValueError, TypeError, AttributeError):
        return None
