"""Does something to a stack, and holds what follows against the rules of `obk launch`."""

import os
import random
import signal
from typing import Final

from benchmarks.soak.plan import Trouble
from benchmarks.soak.stack import Stack

__all__ = ["trouble"]

ONLOOKERS: Final = (
    ("monitor", "--format", "json"),
    ("record", "-o", "record-{}.mcap"),
    ("web", "--port", "0"),
    ("topic", "hz", "/obelisk/dummy/est"),
)
AFTER: Final = {
    "deactivate": "inactive",
    "cleanup": "unconfigured",
    "configure": "inactive",
    "activate": "active",
}
"""The state in which a transition leaves a node."""


def trouble(stack: Stack, kind: Trouble, draw: random.Random) -> None:
    """Do one of them, and wait until the stack is active again."""
    match kind:
        case "transitions":
            _transitions(stack, draw)
        case "kill":
            _end_a_process(stack, draw, signal.SIGKILL)
        case "freeze":
            _end_a_process(stack, draw, signal.SIGSTOP)
        case "onlooker":
            _onlooker(stack)
        case "onlookers_leave":
            stack.send_company_away()
        case "reload":
            _reload(stack)


def _transitions(stack: Stack, draw: random.Random) -> None:
    """A node, or all, down some way and up again; the others stay where they are."""
    nodes = sorted(stack.nodes())
    chosen = [draw.choice(nodes)] if nodes and draw.random() < 0.7 else []
    verbs = ["deactivate", "activate"]
    if draw.random() < 0.5:
        verbs[1:1] = ["cleanup", "configure"]
    for verb in verbs:
        done = stack.obk("lifecycle", verb, *chosen)
        if done.returncode:
            stack.blame(f"{verb} {' '.join(chosen)}: {done.stderr.strip()[:200]}")
            break
        for name, node in stack.nodes().items():
            wanted = AFTER[verb] if not chosen or name in chosen else "active"
            if node["state"] != wanted:
                stack.blame(f"{name} is {node['state']} after {verb}, not {wanted}")
    stack.wait_for("active after transitions", stack.is_active)


def _end_a_process(stack: Stack, draw: random.Random, how: signal.Signals) -> None:
    """Its node is back in a new process, and only that one is new."""
    before = {name: node["pid"] for name, node in stack.nodes().items() if node["pid"]}
    if not before:
        return
    chosen = draw.choice(sorted(before))
    os.kill(before[chosen], how)

    def is_back() -> bool:
        node = stack.nodes().get(chosen, {})
        return node.get("pid") not in (None, before[chosen]) and stack.is_active()

    if stack.wait_for(f"{chosen} back and all active after {how.name}", is_back):
        for name, node in stack.nodes().items():
            if name != chosen and node["pid"] != before.get(name):
                stack.blame(f"{name} was started again, as {chosen} got {how.name}")


def _onlooker(stack: Stack) -> None:
    words = ONLOOKERS[stack.visits % len(ONLOOKERS)]
    stack.company.append(stack.start(*(word.format(stack.visits) for word in words)))
    stack.visits += 1


def _reload(stack: Stack) -> None:
    """The config is changed while the stack runs, and what is launched next is the new text."""
    rate_hz = stack.change_period()
    stack.stop()
    stack.launch()

    def is_promised() -> bool:
        rates = (rate for node in stack.nodes().values() for rate in node["rates"])
        return any(abs(rate["expected_hz"] - rate_hz) < 1e-3 * rate_hz for rate in rates)

    stack.wait_for(f"a promise of {rate_hz:g} Hz, as the changed config has it", is_promised)
