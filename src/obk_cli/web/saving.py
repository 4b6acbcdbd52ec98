"""Show and write the changes of a stack's tuned parameters to its config."""

from collections.abc import Mapping
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from obk_cli.compiler import Options
from obk_cli.errors import CommandFailedError
from obk_cli.files import STANDARD_INPUT
from obk_cli.introspect.config_update import ConfigUpdate, find_update
from obk_cli.introspect.target import target_of
from obk_cli.monitor.model import StackView
from obk_cli.process.identity import working_folder
from obk_cli.ros.environment import DOMAIN, RosEnvironment
from obk_cli.runs.folder import read_run

__all__ = ["update_data", "update_of_stack"]

TIMEOUT_S: Final = 5.0
"""Limit for each answer of a node [s]."""


def update_of_stack(
    view: StackView, runs: Path, environment: RosEnvironment, variables: Mapping[str, str]
) -> ConfigUpdate:
    """The changes that `obk param save` would write for a stack.

    Args:
        view: the stack.
        runs: the folder of all runs.
        environment: the ROS environment.
        variables: values for `${VAR}` in the config.

    Raises:
        CommandFailedError: the stack is not running on this host, its config is not a file, or as
            in `find_update`.
    """
    run = read_run(runs / view.run) if view.run else None
    folder = working_folder(run.pid) if run else None
    if run is None or folder is None or view.has_ended:
        raise CommandFailedError(
            "the config is available only for a stack that is running on this host"
        )
    if run.config == STANDARD_INPUT:
        raise CommandFailedError("the stack was launched from standard input, not from a file")
    in_domain = {**environment.variables, DOMAIN: str(view.domain)}
    return find_update(
        str(folder / run.config),
        Options(variables=variables, working_folder=folder),
        target_of(replace(environment, variables=in_domain), view.domain),
        TIMEOUT_S,
    )


def update_data(update: ConfigUpdate) -> dict[str, Any]:
    """An update in the page's format; `digest` identifies the edit that the page shows."""
    diff = update.diff()
    return {
        "config": update.config,
        "diff": diff,
        "digest": sha256(diff.encode()).hexdigest(),
        "changes": [*update.changes()],
        "faults": [*update.faults()],
        "missing_nodes": list(update.missing_nodes),
    }
