"""What a recording tells of the run that it is of: config as compiled, hash, versions, parameters.

In: a run's folder, which the launcher wrote before anything started. Out: texts and key-value
metadata for the beginning of the file.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Final

from obk_cli.runs.folder import config_of, read_record

__all__ = ["Background", "background_of", "file_name"]

PLAN_FILE: Final = "plan.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Background:
    """What stands first in a recording."""

    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: Mapping[str, str] = field(default_factory=dict)


def file_name(folder: Path | None, when: datetime) -> str:
    """The name of a recording's file where the user gives none."""
    return f"{config_of(folder) if folder else 'ros'}_{when:%Y%m%d_%H%M%S}.mcap"


def background_of(folder: Path) -> Background:
    """The background of a run; what its folder does not tell is left out."""
    run = read_record(folder)
    told = {key: str(run[key]) for key in ("name", "config", "domain", "plan_sha256") if key in run}
    told_versions = run.get("versions")
    every = told_versions.items() if isinstance(told_versions, dict) else ()
    versions = {key: str(value) for key, value in every}
    plan = {PLAN_FILE: json.dumps(run["plan"], indent=1)} if "plan" in run else {}
    return Background(
        metadata={"obelisk": {"run": folder.name, **told}, "obelisk_versions": versions},
        attachments={**plan, **_parameters(folder)},
    )


def _parameters(folder: Path) -> Mapping[str, str]:
    texts = {}
    for path in sorted((folder / "params").glob("*.yaml")):
        texts[f"params/{path.name}"] = path.read_text(encoding="utf-8", errors="replace")
    return texts
