"""What runs already, and what was left behind? Facts in, findings out."""

from collections.abc import Iterator
from dataclasses import dataclass

from obk_cli.doctor.finding import Finding, note, ok, warning

__all__ = ["RunningStack", "StackFacts", "judge_stacks"]


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
            f"the stack `{stack.name}` runs in ROS domain {stack.domain} (launcher {stack.pid})",
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
        yield ok("no stack runs, and none left anything behind")
