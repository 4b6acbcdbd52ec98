"""Files that are there with other content: on a terminal, the user is asked about each.

In: decisions. Out: decisions. Without a terminal nothing is asked and nothing changes.
"""

import sys
from dataclasses import replace

from obk_cli.errors import CommandFailedError
from obk_cli.scaffold.describe import unified_diff
from obk_cli.scaffold.write import Action, Decision

__all__ = ["settle_conflicts"]

_CHOICES = "[k]eep it, [r]eplace it, show the [d]ifference, [q]uit"


def settle_conflicts(decisions: tuple[Decision, ...]) -> tuple[Decision, ...]:
    """Ask about each file in the way that could be replaced; the others stay in the way.

    Raises:
        CommandFailedError: the user wants nothing of it.
    """
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return decisions
    return tuple(_settle(d) if _can_be_replaced(d) else d for d in decisions)


def _can_be_replaced(decision: Decision) -> bool:
    return decision.action is Action.CONFLICT and decision.before is not None


def _settle(decision: Decision) -> Decision:
    while True:
        match _ask(f"{decision.file.path} {decision.reason}: {_CHOICES}? "):
            case "k" | "keep":
                return replace(decision, action=Action.KEEP)
            case "r" | "replace":
                return replace(decision, action=Action.REPLACE)
            case "d" | "diff" | "difference":
                print(unified_diff([decision]), file=sys.stderr, end="")
            case "q" | "quit":
                raise CommandFailedError("nothing was made")
            case _:
                print("k, r, d or q was expected", file=sys.stderr)


def _ask(question: str) -> str:
    print(question, file=sys.stderr, end="", flush=True)
    answer = sys.stdin.readline()
    return answer.strip().lower() if answer else "quit"
