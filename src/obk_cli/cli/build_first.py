"""What `obk launch` does about message packages: compiles what changed, has the nodes find them."""

import os
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from obelisk_spec.suggestions import list_names
from obk_cli.adapters.overlay import overlay_prefixes
from obk_cli.adapters.overlay_environment import import_from, with_overlays
from obk_cli.adapters.packages import PackageIndex
from obk_cli.adapters.ros_environment import RosEnvironment
from obk_cli.building.build import BuildOptions, survey_of
from obk_cli.cli.build import build_shown
from obk_cli.cli.config_options import wants_colour
from obk_cli.errors import CommandFailedError
from obk_interfaces import InterfaceError

__all__ = ["on_overlays"]


def on_overlays(
    folder: Path, environment: RosEnvironment, *, may_build: bool, color: str
) -> tuple[PackageIndex, RosEnvironment]:
    """The packages for a config in `folder`, and the environment in which nodes find them.

    Message packages are up to date, and this process finds them too. With `may_build` off, what is
    missing or stale is told on stderr. `color` is the word of the option.

    Raises:
        CommandFailedError: a package cannot be compiled.
    """
    workspaces = PackageIndex.around(folder, Path.cwd(), environment.variables).workspaces
    for place, workspace in reversed([*enumerate(workspaces)]):
        # As the shell has it: what is put there for nodes is not for compilers.
        shell = with_overlays(os.environ, overlay_prefixes(workspaces[place + 1 :]))
        if may_build:
            _build(workspace, shell, colour=wants_colour(color, to_stderr=True))
        else:
            _warn_of_stale(workspace, shell)
    overlays = overlay_prefixes(workspaces)
    import_from(overlays)
    variables = with_overlays(environment.variables, overlays)
    packages = PackageIndex.around(folder, Path.cwd(), variables)
    return packages, replace(environment, variables=variables)


def _build(workspace: Path, environment: Mapping[str, str], *, colour: bool) -> None:
    options = BuildOptions(environment=environment, only_messages=True)
    built = build_shown(workspace, options, colour=colour)
    if built.built:
        print(f"built {list_names(built.built)} in {built.duration_s:.1f} s", file=sys.stderr)


def _warn_of_stale(workspace: Path, environment: Mapping[str, str]) -> None:
    try:
        survey = survey_of(workspace, environment)
    except InterfaceError as error:
        raise CommandFailedError(str(error)) from error
    for state, words in (("missing", "not compiled"), ("changed", "changed since compiled")):
        names = [one.name for one in survey.stale if one.state == state]
        if names:
            print(
                f"warning: {list_names(names)}: {words}; left so by `--no-build`", file=sys.stderr
            )
