"""The run registry: find, select and stop the stacks that are running on this host."""

import signal
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from obelisk_spec.components import TIERS
from obelisk_spec.suggestions import did_you_mean, with_number
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.files import is_untrusted, is_within_untrusted
from obk_cli.process.identity import boot_id, is_process, signal_process, wait_for_ends
from obk_cli.runs.folder import Run, read_run, run_folders
from obk_cli.runs.orphans import end_orphans, find_orphans
from obk_cli.runs.protocol import ANSWER_S, NodeStatus, StackStatus, ask_status, ask_stop

__all__ = [
    "NO_ANSWER",
    "STOP_S",
    "LiveStack",
    "NodeSelection",
    "end_launcher",
    "in_tier_order",
    "is_alive",
    "live_folders",
    "live_runs",
    "live_stacks",
    "name_ends",
    "node_statuses",
    "section_of",
    "select_nodes",
    "select_runs",
    "select_stack",
    "stack_nodes",
    "status_text",
]

NO_ANSWER: Final = "no answer"
"""Replaces a node's state if there is no answer."""
LauncherEnd = Literal["ended", "killed", "running"]
STOP_S: Final = 15.0
"""How long a shutdown may take before the stack counts as stuck [s]."""
KILL_S: Final = 5.0
"""Maximum time to wait for a killed process to exit [s]."""
EXIT_S: Final = 2.0
"""Maximum time to wait for a launcher's process to exit once its run is over [s]."""
WARDEN_S: Final = 2.0
"""Maximum time to wait for the nodes of a killed launcher to exit [s]."""
POLL_S: Final = 0.02


def is_alive(run: Run) -> bool:
    """Whether the run's launcher is running and has not recorded its end."""
    if run.ended is not None or run.boot not in ("", boot_id()):
        return False
    return is_process(run.pid, run.started)


def live_folders(parent: Path) -> Mapping[Path, Run]:
    """Folder -> run of this user's live launchers, newest first, in all ROS domains."""
    if is_within_untrusted(parent):
        return {}
    own = (folder for folder in run_folders(parent) if not is_untrusted(folder))
    runs = ((folder, read_run(folder)) for folder in own)
    return {folder: run for folder, run in runs if run is not None and is_alive(run)}


def live_runs(parent: Path) -> tuple[Run, ...]:
    """This user's runs with a live launcher, in all ROS domains."""
    return tuple(live_folders(parent).values())


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveStack:
    """A running stack, or the part of it that one launcher runs."""

    folder: Path
    run: Run
    status: StackStatus | None
    """None: the launcher does not answer."""

    @property
    def life_cycle_nodes(self) -> tuple[NodeStatus, ...]:
        """The nodes with states; empty if the launcher does not answer."""
        return tuple(node for node in (self.status.nodes if self.status else ()) if node.state)


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeSelection:
    """Selected nodes of one stack."""

    stack: LiveStack
    nodes: tuple[str, ...]
    """Full names; empty: the whole stack."""


def live_stacks(runs: Mapping[Path, Run], timeout_s: float = ANSWER_S) -> tuple[LiveStack, ...]:
    """The stacks of live runs with the status that their launchers report.

    Args:
        runs: folder -> live run.
        timeout_s: limit for each launcher's answer [s].
    """
    return tuple(
        LiveStack(folder=folder, run=run, status=ask_status(folder, timeout_s))
        for folder, run in runs.items()
    )


def select_runs(
    parent: Path, name: str | None = None, *, domain: int | None = None
) -> Mapping[Path, Run]:
    """The live runs on this host with this name and ROS domain, newest first.

    Args:
        parent: the folder of all runs.
        name: name of a config or run folder; None: all.
        domain: only this ROS domain; None: all.

    Raises:
        CommandFailedError: no live run has the given name.
    """
    live = live_folders(parent)
    candidates = {folder: run for folder, run in live.items() if domain in (None, run.domain)}
    if name is None:
        return candidates
    selected = {
        folder: run for folder, run in candidates.items() if name in (run.name, folder.name)
    }
    if not selected:
        where = "on this host" if domain is None else f"in ROS domain {domain} on this host"
        names = sorted({run.name for run in candidates.values()})
        raise CommandFailedError(
            f"no stack `{name}` is running {where}",
            help=did_you_mean(name, names) or "`obk ps` lists the running stacks",
        )
    return selected


def node_statuses(
    stacks: Sequence[LiveStack], names: Sequence[str]
) -> Mapping[str, NodeStatus] | None:
    """The status of the named nodes; None if the launchers on this host do not know them all.

    Args:
        stacks: stacks running on this host.
        names: as given by the user; empty: all nodes.
    """
    if not names and not all(stack.status for stack in stacks):
        return None
    known: dict[str, NodeStatus] = {}
    for stack in stacks:
        for node in stack.life_cycle_nodes:
            # If two launchers run one stack, the one that runs the node is up to date.
            if node.node not in known or node.pid is not None:
                known[node.node] = node
    selected = [select_nodes(name, known) for name in names] if names else [tuple(known)]
    if not all(selected):
        return None
    selected_nodes = {node for nodes in selected for node in nodes}
    return {name: status for name, status in known.items() if name in selected_nodes}


def select_stack(stacks: Sequence[LiveStack], names: Sequence[str]) -> NodeSelection | None:
    """The stack whose launcher can change the state of these nodes; None if no launcher here can.

    Args:
        stacks: stacks running on this host.
        names: as given by the user; empty: the whole stack.

    Raises:
        MisuseError: the names match nodes of several stacks.
    """
    matching = [
        selection for stack in stacks if (selection := _selection(stack, names)) is not None
    ]
    stack_names = sorted({selection.stack.run.name for selection in matching})
    if len(stack_names) > 1:
        raise MisuseError(
            f"several stacks are running in ROS domain {matching[0].stack.run.domain}: "
            f"{', '.join(stack_names)}",
            help="choose one with `--run NAME`, or use full node names",
        )
    # One launcher per device: prefer the one that runs the nodes, then the leading one.
    best = max(matching, key=_fitness, default=None)
    return best if best and best.stack.status else None


def _selection(stack: LiveStack, names: Sequence[str]) -> NodeSelection | None:
    if not names:
        return NodeSelection(stack=stack, nodes=())
    known = [node.node for node in stack.life_cycle_nodes]
    selected = [select_nodes(name, known) for name in names]
    if not all(selected):
        return None
    return NodeSelection(stack=stack, nodes=tuple(_in_order_of(known, selected)))


def _in_order_of(known: Iterable[str], selected: Iterable[tuple[str, ...]]) -> Iterable[str]:
    selected_nodes = {node for nodes in selected for node in nodes}
    return (node for node in known if node in selected_nodes)


def _fitness(selection: NodeSelection) -> tuple[bool, bool]:
    run = selection.stack.run
    return bool(selection.nodes) and set(selection.nodes) <= set(run.nodes), run.leads


def select_nodes(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """The nodes with this name, full or short (`control_0`), or in this section."""
    every = tuple(known)
    if name in every:
        return (name,)
    by_name = tuple(node for node in every if node.endswith(name_ends(name)))
    return by_name or tuple(node for node in every if section_of(node) == name)


def name_ends(name: str) -> tuple[str, ...]:
    """The ends of the full names that a short one means: `left/control_0`, as `obk launch` prints.

    It means `/left/obelisk_control_0`, and `control_0/get_state` means the service
    `/obelisk_control_0/get_state`.
    """
    short = name.lstrip("/")
    namespace, slash, last = short.rpartition("/")
    return (f"/{short}", f"/obelisk_{short}", f"/{namespace}{slash}obelisk_{last}")


def stack_nodes(found: Iterable[str]) -> tuple[str, ...]:
    """Those lifecycle nodes in the ROS graph that belong to a stack, in tier order.

    A stack's nodes are named after their sections. If no node has such a name, all nodes are
    returned.
    """
    every = in_tier_order(found)
    return tuple(node for node in every if section_of(node)) or every


def section_of(node: str) -> str | None:
    """The section in a node's name (`/ns/obelisk_control_0` -> `control`), or None."""
    parts = node.rpartition("/")[2].split("_")
    is_ours = len(parts) > 2 and parts[0] == "obelisk" and parts[1] in TIERS
    return parts[1] if is_ours else None


def in_tier_order(nodes: Iterable[str]) -> tuple[str, ...]:
    """Nodes sorted by the tier in their names, unknown ones last."""

    def rank(node: str) -> tuple[int, str]:
        section = section_of(node)
        return (TIERS.index(section) if section else len(TIERS), node)

    return tuple(sorted(nodes, key=rank))


def status_text(node: NodeStatus) -> str:
    """A node's status on one line, without its name."""
    return "  ".join(
        [
            f"{node.state or 'no lifecycle':<13}",
            f"process {node.pid}" if node.pid is not None else "not running on this host",
            *(["HUNG"] if node.hangs else ()),
            *([f"restarted {with_number(node.restarts, 'time')}"] if node.restarts else ()),
        ]
    )


def end_launcher(
    folder: Path, run: Run, *, reason: str, timeout_s: float = STOP_S, may_kill: bool = False
) -> LauncherEnd:
    """Ask a launcher to shut down its stack, and wait until it has exited.

    The request goes over the control socket or, if that fails, is sent as SIGINT; a suspended
    launcher is resumed first.

    Args:
        folder: the folder of the run.
        run: the run that the folder describes.
        reason: shown by the launcher.
        timeout_s: limit for the answer and the shutdown [s].
        may_kill: kill the launcher and its processes if it does not exit in time.
    """

    def is_running() -> bool:
        return is_alive(read_run(folder) or run)

    # A suspended launcher (Ctrl-Z) could not shut anything down.
    signal_process(run.pid, run.started, signal.SIGCONT)
    end = time.monotonic() + timeout_s
    # Do not send SIGINT before the request has failed: a launcher that is slow to answer would
    # treat it as a forced quit.
    if not ask_stop(folder, reason, timeout_s / 2):
        signal_process(run.pid, run.started, signal.SIGINT)
    if _wait_until(lambda: not is_running(), end - time.monotonic()):
        # The run is over; the process of its launcher is about to exit.
        wait_for_ends([(run.pid, run.started)], EXIT_S)
        return "ended"
    if not may_kill:
        return "running"
    signal_process(run.pid, run.started, signal.SIGKILL)
    if not _wait_until(lambda: not is_running(), KILL_S):
        return "running"
    parent = folder.parent
    _wait_until(lambda: not find_orphans(parent, run=folder.name), WARDEN_S)
    end_orphans(find_orphans(parent, run=folder.name))
    return "killed"


def _wait_until(condition: Callable[[], bool], timeout_s: float) -> bool:
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(POLL_S)
    return True
