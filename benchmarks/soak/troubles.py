"""Inject faults into a stack, and check that `obk launch` handles them correctly."""

import os
import random
import signal
from typing import Final

from benchmarks.soak.plan import Trouble
from benchmarks.soak.stack import Stack

__all__ = ["trouble"]

OBSERVERS: Final = (
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
    """Inject a fault, and wait until the stack is active again."""
    match kind:
        case "transitions":
            _transitions(stack, draw)
        case "kill":
            _end_a_process(stack, draw, signal.SIGKILL)
        case "freeze":
            _end_a_process(stack, draw, signal.SIGSTOP)
        case "observer":
            _start_observer(stack)
        case "observers_leave":
            stack.stop_observers()
        case "reload":
            _reload(stack)


def _transitions(stack: Stack, draw: random.Random) -> None:
    """Deactivate one node or all, and activate them again; other nodes must keep their states."""
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
                stack.blame(f"{name} is {node['state']} after {verb}, expected {wanted}")
    stack.wait_for("an active stack after transitions", stack.is_active)


def _end_a_process(stack: Stack, draw: random.Random, how: signal.Signals) -> None:
    """Send a signal to a process; only its node must be restarted, in a new process."""
    before = {name: node["pid"] for name, node in stack.nodes().items() if node["pid"]}
    if not before:
        return
    chosen = draw.choice(sorted(before))
    os.kill(before[chosen], how)

    def is_back() -> bool:
        node = stack.nodes().get(chosen, {})
        return node.get("pid") not in (None, before[chosen]) and stack.is_active()

    if stack.wait_for(f"a restart of {chosen} and an active stack after {how.name}", is_back):
        for name, node in stack.nodes().items():
            if name != chosen and node["pid"] != before.get(name):
                stack.blame(f"{name} was restarted after {how.name} to {chosen}")


def _start_observer(stack: Stack) -> None:
    number = stack.observers_started
    words = OBSERVERS[number % len(OBSERVERS)]
    stack.observers.append(stack.start(*(word.format(number) for word in words)))
    stack.observers_started += 1


def _reload(stack: Stack) -> None:
    """Change the config while the stack runs; the next launch must use the new config."""
    rate_hz = stack.change_period()
    stack.stop()
    stack.launch()

    def is_expected() -> bool:
        rates = (rate for node in stack.nodes().values() for rate in node["rates"])
        return any(abs(rate["expected_hz"] - rate_hz) < 1e-3 * rate_hz for rate in rates)

    stack.wait_for(f"an expected rate of {rate_hz:g} Hz, as in the changed config", is_expected)
