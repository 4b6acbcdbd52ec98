"""Model how a real run differs from the ideal one: latency, jitter, phases, bring-up.

In the ideal schedule, nothing takes time and all nodes become active at once. The nodes of a real
stack become active one after another, so its robot moves for some steps before the first command
arrives. The events of a real run record when each node became active; `bring_up_times` reads them.
"""

import json
import math
import os
import random
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Self

from obk_cli.errors import CommandFailedError
from obk_cli.plan.plan import Plan, PlannedNode
from obk_cli.runs.folder import config_of, run_folders, runs_folder
from obk_testing.arguments import require_time

__all__ = ["BringUp", "Schedule", "bring_up_times"]

MEASURED: Final = "measured"
"""Selects the bring-up of the most recent real run of the stack on this machine."""

BringUp = Mapping[str, float] | str | Path
"""Node -> when it becomes active [s]; `measured`; or a run's folder or its `events.jsonl`."""

_EVENTS: Final = "events.jsonl"
_ROUNDING: Final = 1e-6
_MOST_JITTER_S: Final = 0.0003
_LATEST_START_S: Final = 0.02
"""Maximum for a varied schedule: more than the delay between nodes on an idle host."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """Differences from an ideal run, in which nothing takes time; times in seconds."""

    latency: float = 0.0
    """Time from publishing a message to its arrival."""
    jitter: float = 0.0
    """Maximum random addition to the latency, drawn for each message by the seed."""
    phases: bool = False
    """Whether timers start at a random part of their period, drawn by the seed."""
    compute: Mapping[str, float] = field(default_factory=dict)
    """Node -> computing time of each of its callbacks."""
    bring_up: Mapping[str, float] = field(default_factory=dict)
    """Node -> when it becomes active; the others at time 0."""

    def __post_init__(self) -> None:
        """Check the times.

        Raises:
            ValueError: one is negative or not finite.
        """
        require_time("the latency", self.latency)
        require_time("the jitter", self.jitter)
        for node, seconds in self.compute.items():
            require_time(f"the computing time of {node}", seconds)
        for node, seconds in self.bring_up.items():
            require_time(f"the activation time of {node}", seconds)

    @classmethod
    def varied(cls, seed: int, nodes: Iterable[str]) -> Self:
        """Draw a schedule by a seed; seed 0 gives the ideal one.

        Args:
            seed: seed of the trial.
            nodes: full names of the nodes that may become active later.
        """
        if seed == 0:
            return cls()
        draw = random.Random(f"varied schedule {seed}")  # noqa: S311
        return cls(
            jitter=draw.uniform(0.0, _MOST_JITTER_S),
            phases=True,
            bring_up={node: draw.uniform(0.0, _LATEST_START_S) for node in nodes},
        )


def bring_up_times(
    given: BringUp,
    plan: Plan,
    folder: Path = Path(),
    *,
    environment: Mapping[str, str] = os.environ,
) -> Mapping[str, float]:
    """Return when each node becomes active after the simulator's first step: node -> time [s].

    Args:
        given: these times, or their source.
        plan: the stack.
        folder: base of a relative path.
        environment: variables, which set the folder of all runs.

    Raises:
        CommandFailedError: the run does not exist, or a node did not become active in it.
    """
    if isinstance(given, Mapping):
        return given
    if given == MEASURED:
        return _newest_bring_up(plan, runs_folder(environment))
    path = folder / given
    if path.is_dir():
        path /= _EVENTS
    try:
        found = read_activations(path)
    except OSError as error:
        raise CommandFailedError(
            f"the bring-up cannot be read from {path}: {error.strerror}",
            help=f"pass a run folder of `obk launch`, its `{_EVENTS}`, or '{MEASURED}'",
        ) from error
    missing = sorted(_nodes(plan) - found.keys())
    if missing:
        raise CommandFailedError(
            f"{', '.join(missing)} did not become active in {path}",
            help=f"pass a run of `{plan.name}` in which all nodes became active",
        )
    return _after_first_step(plan, found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Activation:
    """A node's first activation in a real run."""

    answered_s: float
    """When the launcher received the node's response [s since 1970]."""
    took_s: float
    """Time from the launcher's request to the response [s]."""
    simulated_s: float | None = None
    """Simulated time of the activation as reported by the node [s]; None if not reported."""
    first_output_s: float | None = None
    """Simulated time of its first publication [s]; None if not reported."""


def read_activations(events: Path) -> dict[str, Activation]:
    """Read the first activation of each node of a run, by full name.

    Args:
        events: the run's `events.jsonl`.

    Raises:
        OSError: the file cannot be read.
    """
    found: dict[str, Activation] = {}
    for event in _events(events):
        is_activation = event.get("event") == "TransitionEnded" and (
            (event.get("transition"), event.get("result")) == ("activate", "reached")
        )
        if is_activation:
            activation = Activation(
                answered_s=float(event.get("time", 0.0)), took_s=float(event.get("seconds", 0.0))
            )
            found.setdefault(str(event.get("node")), activation)
        elif event.get("event") == "ActivationReported":
            node = str(event.get("node"))
            if node in found and found[node].simulated_s is None:
                found[node] = replace(
                    found[node],
                    simulated_s=float(event.get("simulated_s", 0.0)),
                    first_output_s=event.get("first_output_s"),
                )
    return found


def _events(path: Path) -> Iterator[Mapping[str, Any]]:
    with path.open(encoding="utf-8", errors="replace") as lines:
        for line in lines:
            try:
                event = json.loads(line)
            except ValueError:
                continue  # the last line of a killed run
            if isinstance(event, dict):
                yield event


def _newest_bring_up(plan: Plan, runs: Path) -> dict[str, float]:
    name = plan.name.replace("/", "_")
    for folder in run_folders(runs):
        if config_of(folder) != name:
            continue
        try:
            found = read_activations(folder / _EVENTS)
        except OSError:
            continue
        if found.keys() >= _nodes(plan):
            return _after_first_step(plan, found)
    raise CommandFailedError(
        f"`measured` needs a run of `{plan.name}` in {runs} in which all nodes became "
        "active, but there is none",
        help="run `obk launch CONFIG --duration 3` once on this machine, or pass the times: "
        "bring_up={'control': 0.02}",
    )


def _nodes(plan: Plan) -> set[str]:
    return {node.full_name for node in plan.nodes}


def _after_first_step(plan: Plan, found: Mapping[str, Activation]) -> dict[str, float]:
    """Return when nodes become active after the first step of the simulator [s].

    Nodes with simulated time report it themselves, a second later. For other nodes, only the time
    of the response to the launcher is known. The simulator starts stepping during its activation.
    The first step is estimated at the middle of this activation, so the error is at most half of
    it.
    """
    simulators = [found[node.full_name] for node in plan.nodes if node.model]
    if simulators:
        origin_s = simulators[0].answered_s - simulators[0].took_s / 2
    else:
        origin_s = min(activation.answered_s for activation in found.values())

    def start_s(node: PlannedNode) -> float:
        activation = found[node.full_name]
        if activation.simulated_s is not None:
            return activation.simulated_s + _idle_s(node, activation)
        # Rounded to 1 us, because times since 1970 have no more precision.
        return round(max(0.0, activation.answered_s - origin_s), 6)

    return {node.full_name: 0.0 if node.model else start_s(node) for node in plan.nodes}


def _idle_s(node: PlannedNode, activation: Activation) -> float:
    """Return how long an active node published nothing, in whole periods of its timer [s].

    Its first inputs are late, because connections between processes are made at that time.
    """
    period_s = max((each.period_s for each in node.rates if each.topic), default=0.0)
    if activation.first_output_s is None or activation.simulated_s is None or period_s <= 0.0:
        return 0.0
    until_s = activation.first_output_s - activation.simulated_s
    # A tick is never early, and some periods are not exact floats.
    return max(0, math.floor(until_s / period_s + _ROUNDING) - 1) * period_s
