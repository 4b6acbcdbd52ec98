"""The recording that a user means by a name, and what a recording says about its run.

Needs no MCAP library.
"""

import json
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Final

from obk_cli.runs.folder import config_of, read_record

__all__ = [
    "RunMetadata",
    "file_name",
    "run_metadata_of",
]


PLAN_FILE: Final = "plan.json"
GIT_S: Final = 2.0
"""Longest time that git may take [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunMetadata:
    """Metadata records and attachments at the start of a recording."""

    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: Mapping[str, str] = field(default_factory=dict)


def file_name(folder: Path | None, when: datetime) -> str:
    """The default name of a recording's file."""
    return f"{config_of(folder) if folder else 'ros'}_{when:%Y%m%d_%H%M%S}.mcap"


def run_metadata_of(folder: Path) -> RunMetadata:
    """The metadata of a run; what its folder lacks is left out."""
    run = read_record(folder)
    stored = {
        key: str(run[key]) for key in ("name", "config", "domain", "plan_sha256") if key in run
    }
    recorded_versions = run.get("versions")
    every = recorded_versions.items() if isinstance(recorded_versions, dict) else ()
    versions = {key: str(value) for key, value in every}
    plan = {PLAN_FILE: json.dumps(run["plan"], indent=1)} if "plan" in run else {}
    code = {"obelisk_code": found} if (found := _code(run.get("config"))) else {}
    return RunMetadata(
        metadata={
            "obelisk": {"run": folder.name, **stored},
            "obelisk_versions": versions,
            **code,
        },
        attachments={**plan, **_parameters(folder)},
    )


def _code(config: object) -> Mapping[str, str]:
    """The commit of the workspace of a config; empty if it is in no git repository."""
    if not isinstance(config, str):
        return {}
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        described = subprocess.run(
            command,
            cwd=Path(config).parent,
            capture_output=True,
            text=True,
            timeout=GIT_S,
            check=True,
        )
    except (OSError, ValueError, subprocess.SubprocessError):
        return {}
    return {"commit": described.stdout.strip()}


def _parameters(folder: Path) -> Mapping[str, str]:
    texts = {}
    for path in sorted((folder / "params").glob("*.yaml")):
        texts[f"params/{path.name}"] = path.read_text(encoding="utf-8", errors="replace")
    return texts
