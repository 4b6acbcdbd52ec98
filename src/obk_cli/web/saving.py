"""Show and write what the tuned parameters of a stack change in its config."""

from collections.abc import Mapping
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from obk_cli.compiler import Options
from obk_cli.errors import CommandFailedError
from obk_cli.files import STANDARD_INPUT
from obk_cli.introspect.config_update import ConfigUpdate, find_update
from obk_cli.introspect.target import DOMAIN, target_of
from obk_cli.monitor.model import StackView
from obk_cli.process.identity import working_folder
from obk_cli.ros.environment import RosEnvironment
from obk_cli.runs.folder import read_run

__all__ = ["update_data", "update_of_stack"]

TIMEOUT_S: Final = 5.0
"""For each answer of a node [s]."""


def update_of_stack(
    view: StackView, runs: Path, environment: RosEnvironment, variables: Mapping[str, str]
) -> ConfigUpdate:
    """What `obk param save` would write for a stack.

    Args:
        view: the stack.
        runs: the folder of all runs.
        environment: of ROS.
        variables: stand in for `${VAR}` in the config.

    Raises:
        CommandFailedError: the stack does not run on this host, its config is no file, or see
            `find_update`.
    """
    run = read_run(runs / view.run) if view.run else None
    folder = working_folder(run.pid) if run else None
    if run is None or folder is None or view.has_ended:
        raise CommandFailedError("the config is known only of a stack that runs on this host")
    if run.config == STANDARD_INPUT:
        raise CommandFailedError("the stack was launched from the standard input, not from a file")
    in_domain = {**environment.variables, DOMAIN: str(view.domain)}
    return find_update(
        str(folder / run.config),
        Options(variables=variables, working_folder=folder),
        target_of(replace(environment, variables=in_domain), view.domain),
        TIMEOUT_S,
    )


def update_data(update: ConfigUpdate) -> dict[str, Any]:
    """An update for the page; `digest` identifies the edit that the page shows."""
    diff = update.diff()
    return {
        "config": update.config,
        "diff": diff,
        "digest": sha256(diff.encode()).hexdigest(),
        "changes": [*update.changes()],
        "faults": [*update.faults()],
        "missing_nodes": list(update.missing_nodes),
    }
