"""Metadata of a run, read from its folder: compiled config, hash, versions, parameters.

A recorder writes them at the start of the file; tools that inspect a running stack read its plan.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from datetime import datetime
from pathlib import Path
from typing import Final

from obk_cli.launch.json_values import value_of
from obk_cli.launch.runs import config_of, read_told
from obk_cli.plan import Endpoint, Origin, Plan, Process, SensorGroup

__all__ = ["RunMetadata", "file_name", "run_metadata_of", "run_plan", "run_topics"]

PLAN_FILE: Final = "plan.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunMetadata:
    """Metadata records and attachments at the start of a recording."""

    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Parameters:
    """The parameters of a node that define how fast its time passes; others are not read."""

    realtime_factor: float = 1.0
    use_sim_time: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class _Process:
    """The part of a plan's process that tools use while it runs."""

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
    """The default name of a recording's file."""
    return f"{config_of(folder) if folder else 'ros'}_{when:%Y%m%d_%H%M%S}.mcap"


def run_metadata_of(folder: Path) -> RunMetadata:
    """The metadata of a run; what its folder lacks is left out."""
    run = read_told(folder)
    stored = {
        key: str(run[key]) for key in ("name", "config", "domain", "plan_sha256") if key in run
    }
    recorded_versions = run.get("versions")
    every = recorded_versions.items() if isinstance(recorded_versions, dict) else ()
    versions = {key: str(value) for key, value in every}
    plan = {PLAN_FILE: json.dumps(run["plan"], indent=1)} if "plan" in run else {}
    return RunMetadata(
        metadata={"obelisk": {"run": folder.name, **stored}, "obelisk_versions": versions},
        attachments={**plan, **_parameters(folder)},
    )


def run_topics(folder: Path) -> Mapping[str, str | None]:
    """The topics of a run's plan, each with its type if the plan knows it."""
    found: dict[str, str | None] = {}
    for process in run_plan(folder).processes:
        for end in (*process.publishes, *process.subscribes):
            found[end.topic] = found.get(end.topic) or end.msg_type
    return found


def run_plan(folder: Path) -> Plan:
    """The plan of a run, reduced to what tools use while it runs; empty if there is none."""
    stored = value_of(_Plan, read_told(folder).get("plan"))
    if stored is None:
        return Plan(name="", processes=())
    return Plan(name=stored.name, processes=tuple(map(_process, stored.processes)))


def _process(stored: _Process) -> Process:
    known = {field.name: getattr(stored, field.name) for field in fields(stored)}
    return Process(**{**known, "parameters": asdict(stored.parameters)})


def _parameters(folder: Path) -> Mapping[str, str]:
    texts = {}
    for path in sorted((folder / "params").glob("*.yaml")):
        texts[f"params/{path.name}"] = path.read_text(encoding="utf-8", errors="replace")
    return texts
