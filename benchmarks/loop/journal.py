"""Save each finished run as a line of JSON, so that an interrupted suite can be resumed."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.loop.cases import Case
from benchmarks.loop.figures import Figures
from benchmarks.loop.suite import Load, Record
from benchmarks.loop.turns import Failed, Run

__all__ = ["append_record", "read_journal", "write_journal"]


def read_journal(path: Path, surroundings: dict[str, Any]) -> tuple[Record, ...]:
    """Read the records of a journal; empty if it does not exist or has other surroundings.

    Args:
        path: the journal.
        surroundings: the machine and versions that make results comparable.
    """
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    if not lines or json.loads(lines[0]) != surroundings:
        return ()
    return tuple(_record(json.loads(line)) for line in lines[1:])


def write_journal(path: Path, surroundings: dict[str, Any], records: Iterable[Record]) -> None:
    """Start a new journal with the records to keep."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [json.dumps(surroundings), *map(_line, records)]
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def append_record(path: Path, record: Record) -> None:
    """Append one record."""
    with path.open("a", encoding="utf-8") as journal:
        journal.write(_line(record) + "\n")


def _line(record: Record) -> str:
    if isinstance(record, Load):
        return json.dumps({"load": asdict(record)})
    kind = "figures" if isinstance(record.outcome, Figures) else "failed"
    head = {"case": record.case.as_dict(), "round": record.round}
    return json.dumps({**head, kind: asdict(record.outcome)})


def _record(found: dict[str, Any]) -> Record:
    if "load" in found:
        return Load(**found["load"])
    outcome = Figures(**found["figures"]) if "figures" in found else Failed(**found["failed"])
    return Run(case=Case(**found["case"]), round=found["round"], outcome=outcome)
