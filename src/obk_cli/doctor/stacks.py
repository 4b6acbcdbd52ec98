"""Check `stacks`: running stacks of this user, and processes that outlived their launcher."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from obk_cli.doctor.finding import Finding, note, ok, warning
from obk_cli.runs.folder import runs_folder
from obk_cli.runs.orphans import find_orphans
from obk_cli.runs.registry import live_runs
from obk_cli.terminal import plain

__all__ = ["RunningStack", "StackFacts", "judge_stacks", "probe_stacks"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunningStack:
    """A stack whose launcher is alive."""

    name: str
    domain: int
    pid: int
    """Of its launcher."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StackFacts:
    """The stacks of this user on this host."""

    running: tuple[RunningStack, ...]
    leftovers: tuple[str, ...]
    """Processes whose launcher is gone: number and command."""


def judge_stacks(facts: StackFacts) -> Iterator[Finding]:
    """Stacks that run and processes that should not."""
    for stack in facts.running:
        yield note(
            f"stack `{stack.name}` is running in ROS domain {stack.domain} (launcher {stack.pid})",
            f"obk stop {stack.name}",
            domain=stack.domain,
            pid=stack.pid,
        )
    if facts.leftovers:
        count = len(facts.leftovers)
        yield warning(
            f"{count} process{'' if count == 1 else 'es'} outlived the launcher: "
            f"{'; '.join(facts.leftovers[:3])}",
            "obk reap",
            leftovers=facts.leftovers,
        )
    if not facts.running and not facts.leftovers:
        yield ok("no stack is running and no process is left over")


def probe_stacks(environment: Mapping[str, str]) -> StackFacts:
    """Find running launchers, and processes whose launcher has exited."""
    parent = runs_folder(environment)
    return StackFacts(
        running=tuple(
            RunningStack(name=run.name, domain=run.domain, pid=run.pid) for run in live_runs(parent)
        ),
        leftovers=tuple(f"{left.pid} {plain(left.command)}" for left in find_orphans(parent)),
    )
