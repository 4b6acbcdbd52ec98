"""Run folders: where a run keeps its logs and tells other terminals what it is.

`<state folder>/obk/runs/<config>_<date>_<time>/` with `run.json` (what runs, under which pid),
`events.jsonl`, and one log a node.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path

from platformdirs import user_state_path

from obk_cli.plan import Plan

__all__ = ["Run", "make_run_folder", "read_runs", "runs_folder", "write_run"]

RUN_FILE = "run.json"


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
    """Full names in bring-up order."""


def runs_folder(environment: Mapping[str, str]) -> Path:
    """The folder of all runs; OBK_HOME moves it."""
    home = environment.get("OBK_HOME")
    return (Path(home) if home else user_state_path("obk")) / "runs"


def make_run_folder(parent: Path, plan: Plan, now: datetime) -> Path:
    """Make the folder of a new run, for its owner only.

    Raises:
        OSError: it cannot be made.
    """
    parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    stem = f"{plan.name}_{now:%Y%m%d_%H%M%S}"
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
    files = sorted(parent.glob(f"*/{RUN_FILE}"), reverse=True)
    return tuple(run for file in files if (run := _read_run(file)) is not None)


def _read_run(file: Path) -> Run | None:
    try:
        data = json.loads(file.read_text())
        return Run(**{**data, "nodes": tuple(data["nodes"])})
    except (OSError, ValueError, TypeError, KeyError):
        return None
