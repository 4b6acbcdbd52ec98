"""`obk ps`: the stacks running on this host, and leftover processes of stopped ones."""

import json
import os
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from obk_cli.cli.options import FormatOption, wants_json
from obk_cli.process.identity import seconds_since
from obk_cli.runs.folder import runs_folder
from obk_cli.runs.orphans import Orphan, find_orphans
from obk_cli.runs.protocol import NodeStatus
from obk_cli.runs.registry import LiveStack, live_stacks, select_runs, status_text
from obk_cli.terminal import plain

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk ps --format json"
LONGEST_COMMAND = 100


def command(format: FormatOption = "text") -> None:
    """List the stacks running on this host, in every ROS domain, with their nodes.

    The command also lists processes that a stack left behind; `obk reap` terminates them.
    """
    is_json = wants_json(format)
    parent = runs_folder(os.environ)
    stacks = live_stacks(select_runs(parent))
    orphans = find_orphans(parent)
    if is_json:
        document = {"stacks": [*map(_data, stacks)], "orphans": [*map(asdict, orphans)]}
        print(json.dumps(document, indent=1))
        return
    for stack in stacks:
        print("\n".join(map(plain, _text(stack))))
    if not stacks:
        print("no stack is running on this host")
    if orphans:
        print("\n".join(_orphan_lines(orphans)))


def _uptime_s(stack: LiveStack) -> float:
    return stack.status.seconds if stack.status else seconds_since(stack.run.started)


def _data(stack: LiveStack) -> dict[str, Any]:
    run, status = stack.run, stack.status
    return {
        "name": run.name,
        "run": stack.folder.name,
        "folder": str(stack.folder),
        "config": run.config,
        "devices": list(run.devices),
        "domain": run.domain,
        "state": status.state if status else None,
        "launcher": run.pid,
        "uptime_s": round(_uptime_s(stack), 3),
        "nodes": [asdict(node) for node in status.nodes] if status else [],
    }


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
