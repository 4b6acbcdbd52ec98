"""The recording that a user means by a name, and what a recording says about its run.

Needs no MCAP library.
"""

import json
import os
import re
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Final

from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import CommandFailedError
from obk_cli.runs.folder import config_of, read_record, run_folders

__all__ = [
    "RECORDING",
    "RunMetadata",
    "file_name",
    "find_recording",
    "run_metadata_of",
]


RECORDING: Final = "recording.mcap"
"""The file in a run's folder."""


def find_recording(parent: Path, name: str | None) -> Path:
    """The path of the recording that a name means.

    Args:
        parent: the folder of all runs.
        name: a file, a folder with one recording, the name of a config (its newest run that was
            recorded; with `~1` behind it the one before) or of a run's folder; None: the newest run
            that was recorded.

    Raises:
        CommandFailedError: no recording has that name.
    """
    if name is not None and os.path.isfile(name):  # noqa: PTH113  (`Path.is_file` raises)
        return Path(name)
    if name is not None and (inside := _in_folder(Path(name))):
        return inside
    folders = run_folders(parent)
    earlier = _EARLIER.fullmatch(name or "")
    name, place = (earlier["name"], int(earlier["place"])) if earlier else (name, 0)
    fitting = [f for f in folders if name is None or name in (f.name, config_of(f))]
    recorded = [f / RECORDING for f in fitting if (f / RECORDING).is_file()]
    if place < len(recorded):
        return recorded[place]
    if recorded:
        raise CommandFailedError(f"only {len(recorded)} runs of `{name}` were recorded")
    how = "record one with `obk launch --record`, or `obk record` while it runs"
    if name is None:
        raise CommandFailedError(f"no run in {parent} was recorded", help=how)
    if fitting:
        raise CommandFailedError(f"the run `{name}` was not recorded", help=how)
    names = dict.fromkeys(config_of(folder) for folder in folders)
    raise CommandFailedError(
        f"there is no file and no run called `{name}`", help=did_you_mean(name, names) or how
    )


def _in_folder(folder: Path) -> Path | None:
    """The only recording in a folder, such as rosbag2 creates."""
    is_there = os.path.isdir(folder)  # noqa: PTH112  (`Path.is_dir` raises)
    files = sorted(folder.glob("*.mcap")) if is_there else []
    return files[0] if len(files) == 1 else None


_EARLIER: Final = re.compile(r"(?P<name>.+)~(?P<place>[0-9]{1,4})")
"""The run before the newest is called `arm~1`."""
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
