"""The stacks of this user on this host, and what was left behind."""

from collections.abc import Mapping

from obk_cli.adapters.leftovers import find_leftovers
from obk_cli.doctor.stacks import RunningStack, StackFacts
from obk_cli.report.escapes import plain
from obk_cli.runs.folder import runs_folder
from obk_cli.runs.registry import live_runs

__all__ = ["probe_stacks"]


def probe_stacks(environment: Mapping[str, str]) -> StackFacts:
    """Look for launchers that are alive, and for nodes whose launcher is not."""
    parent = runs_folder(environment)
    return StackFacts(
        running=tuple(
            RunningStack(name=run.name, domain=run.domain, pid=run.pid) for run in live_runs(parent)
        ),
        leftovers=tuple(f"{left.pid} {plain(left.command)}" for left in find_leftovers(parent)),
    )
