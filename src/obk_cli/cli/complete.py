"""Names for the shell's completion: from the plans of the stacks that run here; loads no ROS."""

import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from obk_cli.adapters.live_runs import live_folders
from obk_cli.launch.runs import Run, runs_folder
from obk_cli.recording.made_from import run_topics

__all__ = ["complete_nodes", "complete_topics"]


def complete_topics(incomplete: str) -> list[str]:
    """The topics that a user may be about to name, in full or by their last part."""
    return _fitting(incomplete, (topic for folder, _ in _runs() for topic in run_topics(folder)))


def complete_nodes(incomplete: str) -> list[str]:
    """The nodes that a user may be about to name, in full or by their last part."""
    return _fitting(incomplete, (node for _, run in _runs() for node in run.all_nodes))


def _runs() -> Iterator[tuple[Path, Run]]:
    # Whatever cannot be read is not completed.
    with suppress(OSError):
        domain = os.environ.get("ROS_DOMAIN_ID")
        for folder, run in live_folders(runs_folder(os.environ)).items():
            if not domain or domain == str(run.domain):
                yield folder, run


def _fitting(incomplete: str, names: Iterable[str]) -> list[str]:
    every = sorted(set(names))
    if not incomplete.startswith("/") and incomplete:
        every = [name.rpartition("/")[2].removeprefix("obelisk_") for name in every]
    return [name for name in every if name.startswith(incomplete)]
