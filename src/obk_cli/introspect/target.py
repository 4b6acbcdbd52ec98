"""The ROS domain that a command observes, and the running stacks in it on this host."""

from collections.abc import Iterable, Mapping, Set
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from obelisk_spec.local_transport.sockets import SocketFolder
from obelisk_spec.runtime_protocol import (
    LOCAL_TRANSPORT_OFF,
    LOCAL_TRANSPORT_VARIABLE,
    SOCKETS_FOLDER,
)
from obk_cli.errors import CommandFailedError
from obk_cli.introspect.resolve import matching_names
from obk_cli.plan.plan import Plan
from obk_cli.process.identity import working_folder
from obk_cli.ros.environment import DOMAIN, RosEnvironment
from obk_cli.runs.folder import Run, plan_of_run, read_run, runs_folder, topics_of_run
from obk_cli.runs.registry import live_folders

__all__ = [
    "NO_NODES_S",
    "GraphTarget",
    "find_message_types",
    "target_of",
    "with_run_types",
]

NO_NODES_S: Final = 1.0
"""Time after which the domain counts as empty; obk's nodes are discovered sooner [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphTarget:
    """A ROS domain, and the runs in it on this host."""

    environment: RosEnvironment
    runs: Mapping[Path, Run]
    """Folder -> live run in the domain on this host, newest first."""
    no_nodes_s: float
    """Limit for finding any node if no run is known [s]."""

    @property
    def domain(self) -> int:
        """The ROS domain."""
        return self.environment.domain

    @property
    def nodes(self) -> tuple[str, ...]:
        """Full names of the nodes that are known to be running."""
        return tuple(node for run in self.runs.values() for node in run.all_nodes)

    @property
    def topics(self) -> Mapping[str, str | None]:
        """The topics of the runs' plans, with their types if the plans contain them."""
        return {name: kind for folder in self.runs for name, kind in topics_of_run(folder).items()}

    def modules(self, topics: Iterable[str]) -> tuple[str, ...]:
        """The Python modules of these topics' types, if the plans contain them."""
        planned = self.topics
        names = (name for topic in topics for name in matching_names(topic, planned))
        types = (kind for name in names if (kind := planned[name]))
        packages = dict.fromkeys(kind.partition("/")[0] for kind in types)
        return ("rosidl_generator_py", *(f"{package}.msg" for package in packages))

    @property
    def plans(self) -> tuple[Plan, ...]:
        """The plans of the runs."""
        return tuple(plan_of_run(folder) for folder in self.runs)

    @property
    def sockets(self) -> Set[str] | None:
        """GIDs of the subscriptions with a socket in the runs; None without a run."""
        found: set[str] = set()
        for folder in self.runs:
            with suppress(OSError):  # its local transport is disabled, or it has just ended
                gids = SocketFolder(str(folder / SOCKETS_FOLDER)).depths()
                found.update(gid.hex() for gid in gids)
        return found if self.runs else None

    def no_nodes_error(self) -> CommandFailedError:
        """The error for a domain in which no node was found."""
        if self.runs:
            names = ", ".join(sorted({run.name for run in self.runs.values()}))
            return CommandFailedError(
                f"none of the nodes of {names} was found in ROS domain {self.domain} in time",
                help="wait longer with `--timeout`; check with `obk ps` whether they are running",
            )
        live = live_folders(runs_folder(self.environment.variables)).values()
        others = [f"{run.name} in {run.domain}" for run in live if run.domain != self.domain]
        return CommandFailedError(
            f"no stack is running in ROS domain {self.domain}, and no other node was found",
            help=(
                f"running in other domains: {', '.join(others)}; select one with `--domain`"
                if others
                else "start a stack with `obk launch`; to find nodes not started by obk, add "
                "`--timeout 5`; for a stack on another host, set "
                "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET on both hosts"
            ),
        )


def target_of(
    environment: RosEnvironment, domain: int | None, no_nodes_s: float = NO_NODES_S
) -> GraphTarget:
    """Find the ROS domain and its runs.

    Args:
        environment: the user's ROS environment.
        domain: given by the user; None: ROS_DOMAIN_ID, otherwise the domain of this host's stacks
            if all are in the same one, otherwise 0.
        no_nodes_s: limit for finding any node if none is known to be running [s].
    """
    variables = environment.variables
    live = live_folders(runs_folder(variables))
    if domain is None and not variables.get(DOMAIN):
        domains = {run.domain for run in live.values()}
        domain = domains.pop() if len(domains) == 1 else None
    if domain is not None:
        environment = replace(environment, variables={**variables, DOMAIN: str(domain)})
    here = {folder: run for folder, run in live.items() if run.domain == environment.domain}
    return GraphTarget(environment=_tapping(environment, here), runs=here, no_nodes_s=no_nodes_s)


def _tapping(environment: RosEnvironment, folders: Iterable[Path]) -> RosEnvironment:
    """The environment in which subscriptions become taps of the most recent of these runs."""
    variables = environment.variables
    folder = next(iter(folders), None)
    if folder is None or variables.get(LOCAL_TRANSPORT_VARIABLE) == LOCAL_TRANSPORT_OFF:
        return environment
    return replace(
        environment,
        variables={**variables, LOCAL_TRANSPORT_VARIABLE: str(folder / SOCKETS_FOLDER)},
    )


def with_run_types(environment: RosEnvironment, run_folder: Path | None) -> RosEnvironment:
    """The environment with the message types of the workspaces, which this process finds as well.

    The workspaces are that of the run's config, relative to its launcher, and the current one.
    """
    # Slow to import, and not needed to find the nodes of a running stack.
    from obk_cli.workspace.overlay import import_from, overlay_prefixes, with_overlays
    from obk_cli.workspace.package_index import PackageIndex

    run = read_run(run_folder) if run_folder else None
    launched_in = working_folder(run.pid) if run else None
    folder = (launched_in / run.config).parent if run and launched_in else Path.cwd()
    index = PackageIndex.around(folder, Path.cwd(), environment.variables)
    overlays = overlay_prefixes(index.workspaces)
    import_from(overlays)
    return replace(environment, variables=with_overlays(environment.variables, overlays))


def find_message_types(target: GraphTarget) -> GraphTarget:
    """Make the message types of the target's stacks known to this process."""
    environment = target.environment
    for folder in target.runs or (None,):
        environment = with_run_types(environment, folder)
    return replace(target, environment=environment)
