"""What a recording tells of the run that it is of: config as compiled, hash, versions, parameters.

In: a run's folder, which the launcher wrote before anything started. Out: texts and key-value
metadata for the beginning of the file.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from datetime import datetime
from pathlib import Path
from typing import Final

from obk_cli.launch.json_values import value_of
from obk_cli.launch.runs import config_of, read_told
from obk_cli.plan.plan import Endpoint, Origin, Plan, Process, SensorGroup

__all__ = ["Background", "background_of", "file_name", "run_plan", "run_topics"]

PLAN_FILE: Final = "plan.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Background:
    """What stands first in a recording."""

    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Parameters:
    """Of a node's parameters those that say how fast its time passes; JSON may not hold others."""

    realtime_factor: float = 1.0
    use_sim_time: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class _Process:
    """Of a plan's process what is looked at while it runs."""

    node: str
    namespace: str
    section: str
    device: str
    package: str
    executable: str
    origin: Origin
    publishes: tuple[Endpoint, ...]
    subscribes: tuple[Endpoint, ...]
    parameters: _Parameters = _Parameters()
    model: str | None = None
    sensor_groups: tuple[SensorGroup, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Plan:
    name: str
    processes: tuple[_Process, ...]


def file_name(folder: Path | None, when: datetime) -> str:
    """The name of a recording's file where the user gives none."""
    return f"{config_of(folder) if folder else 'ros'}_{when:%Y%m%d_%H%M%S}.mcap"


def background_of(folder: Path) -> Background:
    """The background of a run; what its folder does not tell is left out."""
    run = read_told(folder)
    told = {key: str(run[key]) for key in ("name", "config", "domain", "plan_sha256") if key in run}
    told_versions = run.get("versions")
    every = told_versions.items() if isinstance(told_versions, dict) else ()
    versions = {key: str(value) for key, value in every}
    plan = {PLAN_FILE: json.dumps(run["plan"], indent=1)} if "plan" in run else {}
    return Background(
        metadata={"obelisk": {"run": folder.name, **told}, "obelisk_versions": versions},
        attachments={**plan, **_parameters(folder)},
    )


def run_topics(folder: Path) -> Mapping[str, str | None]:
    """The topics of a run's plan with the types that it knows, read from what the run keeps."""
    found: dict[str, str | None] = {}
    for process in run_plan(folder).processes:
        for end in (*process.publishes, *process.subscribes):
            found[end.topic] = found.get(end.topic) or end.msg_type
    return found


def run_plan(folder: Path) -> Plan:
    """Of a run's config as compiled what is looked at while it runs; empty where there is none."""
    told = value_of(_Plan, read_told(folder).get("plan"))
    if told is None:
        return Plan(name="", processes=())
    return Plan(name=told.name, processes=tuple(map(_process, told.processes)))


def _process(told: _Process) -> Process:
    known = {field.name: getattr(told, field.name) for field in fields(told)}
    return Process(**{**known, "parameters": asdict(told.parameters)})


def _parameters(folder: Path) -> Mapping[str, str]:
    texts = {}
    for path in sorted((folder / "params").glob("*.yaml")):
        texts[f"params/{path.name}"] = path.read_text(encoding="utf-8", errors="replace")
    return texts
