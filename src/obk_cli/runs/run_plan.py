"""The compiled config that a run's folder keeps: which nodes and topics belong to the run."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path

import msgspec

from obk_cli.plan.plan import Plan, Process
from obk_cli.runs.folder import read_record

__all__ = ["run_plan", "run_topics"]

_Scalar = bool | int | float | str


@dataclass(frozen=True, slots=True, kw_only=True)
class _KeptProcess(Process):
    """A process whose parameters are of a type that can be checked: one kind of list, not four."""

    parameters: Mapping[str, _Scalar | tuple[_Scalar, ...]] = field(  # type: ignore[assignment]
        default_factory=dict
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _KeptPlan(Plan):
    processes: tuple[_KeptProcess, ...]


def run_topics(folder: Path) -> Mapping[str, str | None]:
    """The topics of a run's plan with the types that it knows, read from what the run keeps."""
    found: dict[str, str | None] = {}
    for process in run_plan(folder).processes:
        for end in (*process.publishes, *process.subscribes):
            found[end.topic] = found.get(end.topic) or end.msg_type
    return found


def run_plan(folder: Path) -> Plan:
    """A run's config as compiled; empty if its folder keeps none that can be read.

    Parameters that JSON cannot hold are texts, as `emit_plan` writes them: `.inf`, `.nan`.
    """
    try:
        kept = msgspec.convert(read_record(folder).get("plan"), _KeptPlan)
    except (ValueError, RecursionError):
        return Plan(name="", processes=())
    return Plan(name=kept.name, processes=tuple(map(_process, kept.processes)))


def _process(kept: _KeptProcess) -> Process:
    return Process(**{field.name: getattr(kept, field.name) for field in fields(kept)})
