"""Where the message types of a running stack are found: in the overlays of its workspace."""

from dataclasses import replace
from pathlib import Path

from obk_cli.process.identity import working_folder
from obk_cli.ros.environment import RosEnvironment
from obk_cli.runs.folder import read_run
from obk_cli.workspace.overlay import import_from, overlay_prefixes, with_overlays
from obk_cli.workspace.package_index import PackageIndex

__all__ = ["with_run_types"]


def with_run_types(environment: RosEnvironment, run_folder: Path | None) -> RosEnvironment:
    """The environment in which message types of the workspace are found, here too.

    The workspace is that of the run's config, as its launcher was called, and the one around here.
    """
    run = read_run(run_folder) if run_folder else None
    launched_in = working_folder(run.pid) if run else None
    folder = (launched_in / run.config).parent if run and launched_in else Path.cwd()
    index = PackageIndex.around(folder, Path.cwd(), environment.variables)
    overlays = overlay_prefixes(index.workspaces)
    import_from(overlays)
    return replace(environment, variables=with_overlays(environment.variables, overlays))
