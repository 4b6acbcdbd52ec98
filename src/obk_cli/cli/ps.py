"""`obk ps`: the stacks running on this host, and leftover processes of stopped ones."""

import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass

from obk_cli.cli.options import FormatOption, wants_json
from obk_cli.process.identity import seconds_since
from obk_cli.runs.folder import runs_folder
from obk_cli.runs.orphans import Orphan, find_orphans
from obk_cli.runs.protocol import NodeStatus
from obk_cli.runs.registry import LiveStack, live_stacks, select_runs, status_text
from obk_cli.terminal import plain

__all__ = ["EXAMPLE", "ListedStacks", "command"]

EXAMPLE = "Example: obk ps --format json"
LONGEST_COMMAND = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class ListedStack:
    """A running stack, or the part of it that runs on this host."""

    name: str
    run: str
    """The name of its run's folder."""
    folder: str
    """The absolute path of this folder."""
    config: str
    """The path of its config."""
    devices: tuple[str, ...]
    """The devices whose nodes run here; empty: all of them."""
    domain: int
    """The ROS domain."""
    state: str | None
    """The furthest state that every node has reached, or the current transition; None: the launcher
    does not answer."""
    launcher: int
    """The PID of the launcher."""
    uptime_s: float
    nodes: tuple[NodeStatus, ...]
    """Empty if the launcher does not answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ListedStacks:
    """The stacks that run on this host, and what others left behind."""

    stacks: tuple[ListedStack, ...]
    orphans: tuple[Orphan, ...]


def command(format: FormatOption = "text") -> None:
    """List the stacks running on this host, in every ROS domain, with their nodes.

    The command also lists processes that a stack left behind; `obk reap` terminates them.
    """
    is_json = wants_json(format)
    parent = runs_folder(os.environ)
    stacks = live_stacks(select_runs(parent))
    orphans = find_orphans(parent)
    if is_json:
        listed = ListedStacks(stacks=tuple(map(_listed, stacks)), orphans=orphans)
        print(json.dumps(asdict(listed), indent=1))
        return
    for stack in stacks:
        print("\n".join(map(plain, _text(stack))))
    if not stacks:
        print("no stack is running on this host")
    if orphans:
        print("\n".join(_orphan_lines(orphans)))


def _uptime_s(stack: LiveStack) -> float:
    return stack.status.seconds if stack.status else seconds_since(stack.run.started)


def _listed(stack: LiveStack) -> ListedStack:
    run, status = stack.run, stack.status
    return ListedStack(
        name=run.name,
        run=stack.folder.name,
        folder=str(stack.folder),
        config=run.config,
        devices=run.devices,
        domain=run.domain,
        state=status.state if status else None,
        launcher=run.pid,
        uptime_s=round(_uptime_s(stack), 3),
        nodes=status.nodes if status else (),
    )


def _text(stack: LiveStack) -> Iterator[str]:
    run, status = stack.run, stack.status
    state = status.state if status else "launcher does not answer"
    device = f" (device {', '.join(run.devices)})" if run.devices else ""
    yield (
        f"{run.name}{device}: {state}, ROS domain {run.domain}, launcher {run.pid}, "
        f"up {_clock(_uptime_s(stack))}, {run.config}"
    )
    nodes = status.nodes if status else ()
    width = max((len(node.node) for node in nodes), default=0)
    for node in nodes:
        yield f"  {node.node:<{width}}  {_node(node)}"
    for name in () if status else run.all_nodes:
        yield f"  {name}"


def _node(node: NodeStatus) -> str:
    rates = (plain(str(rate)) for rate in node.rates if rate.standing != "kept")
    page = (f"shown at {node.page}",) if node.page else ()
    return "  ".join((status_text(node), *rates, *page))


def _orphan_lines(orphans: tuple[Orphan, ...]) -> Iterator[str]:
    yield "orphaned processes (terminate them with `obk reap`):"
    for orphan in orphans:
        yield f"  {orphan.pid}  {orphan.run}  {plain(orphan.command)[:LONGEST_COMMAND]}"


def _clock(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
