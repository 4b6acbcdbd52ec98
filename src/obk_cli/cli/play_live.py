"""`obk play --into CONFIG --real-time`: run nodes as processes on recorded inputs."""

import signal
import sys
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

from obelisk_recordings.find import RECORDING
from obelisk_recordings.run import open_run
from obelisk_spec.suggestions import list_names, with_number
from obk_cli.cli.diff import signal_lines
from obk_cli.cli.options import print_note, with_types
from obk_cli.cli.play_nodes import NodesRequest
from obk_cli.errors import CommandFailedError
from obk_cli.introspect.target import GraphTarget, target_of
from obk_cli.process.child_process import BoundChild
from obk_cli.record.compare import compare_runs
from obk_cli.record.play import Played, command_topics, play
from obk_cli.record.rewrite import rewrite
from obk_cli.ros.domains import free_domain
from obk_cli.ros.environment import DOMAIN, RosEnvironment, ros_environment
from obk_cli.runs.folder import runs_folder
from obk_cli.runs.protocol import ask_status
from obk_cli.runs.registry import live_folders

if TYPE_CHECKING:
    from obelisk_recordings.run import RecordedRun
    from obk_cli.plan.plan import Plan, PlannedNode

__all__ = ["LiveReplay", "refuse_commands", "replay_live"]

BRING_UP_S: Final = 60.0
"""Limit for the nodes to become active [s]."""
END_S: Final = 20.0
"""Limit for the nodes to shut down, and for their recording to finish [s]."""
POLL_S: Final = 0.1
LAST_S: Final = 0.5
"""Wait for the outputs that the last inputs cause [s]."""
_PROGRAM: Final = "obk_cli.cli.play_nodes"


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveReplay:
    """Options of a real-time replay."""

    request: NodesRequest
    inputs: Sequence[str]
    output: Path
    speed: float
    tolerance: float
    """Accepted RMS difference, as a fraction of a signal's span."""
    domain: int | None
    """ROS domain; None: one that no other process uses."""
    may_move: bool
    wait_s: float
    """How long to wait for subscribers of the inputs [s]."""


def refuse_commands(
    plan: "Plan", run: "RecordedRun", chosen: "Sequence[PlannedNode]", inputs: Collection[str]
) -> list[str]:
    """Return the inputs that do not command a robot; report the others.

    Raises:
        CommandFailedError: a node is a real robot, or publishes commands.
    """
    moving = command_topics(run) | {
        end.topic for node in plan.nodes if node.section == "robot" for end in node.subscribes
    }
    for node in chosen:
        sent = [end.topic for end in node.publishes if end.topic in moving]
        if sent or (node.section == "robot" and node.model is None):
            what = f"publishes {list_names(sent)}, which commands a robot" if sent else "is a robot"
            raise CommandFailedError(
                f"{node.full_name} {what}",
                help="replay it in lockstep, without `--real-time`, or add `--allow-hardware`",
            )
    for topic in inputs:
        if topic in moving:
            print_note(f"skipping {topic}: it commands a robot")
    left = [topic for topic in inputs if topic not in moving]
    if not left:
        raise CommandFailedError(f"{run.path} has no other messages for the nodes")
    return left


def replay_live(run: "RecordedRun", replay: LiveReplay) -> None:
    """Run the nodes, publish their inputs, record their outputs, and print how they differ.

    Raises:
        CommandFailedError: the nodes fail or do not become active, or a robot subscribes to an
            input.
        RecordingError: a recording cannot be read.
    """
    with TemporaryDirectory(prefix="obk-play-") as home, _domain(replay.domain) as domain:
        environment = ros_environment("localhost")
        own = {DOMAIN: str(domain), "OBK_HOME": home}
        environment = replace(environment, variables={**environment.variables, **own})
        runs = runs_folder(environment.variables)
        with _running(replay.request, environment) as nodes:
            target = nodes.target_when_active(environment, runs)
            folder = next(iter(target.runs))
            played = play(
                run,
                replay.inputs,
                with_types(target),
                speed=replay.speed,
                may_move=replay.may_move,
                wait_s=replay.wait_s,
                note=print_note,
                sets_clock=True,
            )
            time.sleep(LAST_S)
            nodes.end()
        _keep(run, folder / RECORDING, replay, played)
    total = with_number(sum(played.counts.values()), "message")
    names = list_names(replay.request.nodes)
    print(f"ran {names} on {total} in {played.seconds:.1f} s: {replay.output}")
    _compare(run, replay)


@contextmanager
def _domain(given: int | None) -> Iterator[int]:
    if given is not None:
        yield given
        return
    with free_domain() as domain:
        yield domain


class _Nodes:
    """The launcher process of the nodes, and its output."""

    def __init__(self, request: NodesRequest, environment: RosEnvironment) -> None:
        self._lines: list[str] = []
        self.child = BoundChild(
            [sys.executable, "-P", "-m", _PROGRAM, request.to_json()],
            environment.variables,
            on_line=self._lines.append,
            on_output_end=lambda: None,
        )

    def target_when_active(self, environment: RosEnvironment, runs: Path) -> GraphTarget:
        """Wait until the nodes are active, and return their ROS domain.

        Raises:
            CommandFailedError: they stopped, or did not become active in time.
        """
        end_s = time.monotonic() + BRING_UP_S
        while time.monotonic() < end_s and self.child.exit_code is None:
            for folder in live_folders(runs):
                status = ask_status(folder)
                if status is not None and status.state == "active":
                    return target_of(environment, environment.domain)
            time.sleep(POLL_S)
        raise self._error(f"the nodes did not become active within {BRING_UP_S:g} s")

    def end(self) -> None:
        """Shut the nodes down.

        Raises:
            CommandFailedError: a node failed, or they did not stop.
        """
        self.child.signal(signal.SIGINT)
        if self.child.wait(END_S) != 0:
            raise self._error("the nodes did not shut down cleanly")

    def _error(self, late: str) -> CommandFailedError:
        code = self.child.exit_code
        why = late if code is None else f"the nodes failed (exit code {code})"
        return CommandFailedError("\n".join([f"{why}; their output:", *self._lines]))


@contextmanager
def _running(request: NodesRequest, environment: RosEnvironment) -> Iterator[_Nodes]:
    nodes = _Nodes(request, environment)
    with closing(nodes.child):
        try:
            yield nodes
        finally:
            if nodes.child.exit_code is None:
                nodes.child.signal(signal.SIGINT)
                nodes.child.wait(END_S)


def _keep(run: "RecordedRun", path: Path, replay: LiveReplay, played: Played) -> None:
    """Write the outputs, with their times shifted to those of the recorded run."""
    first_ns = played.first_ns

    def recorded_ns(time_ns: int) -> int:
        return first_ns + round((time_ns - played.start_ns) * replay.speed)

    about = {"obelisk": {"replay": run.name, "rate": f"{replay.speed:g}"}}
    rewrite(open_run(path), replay.output, replay.request.outputs, recorded_ns, about)


def _compare(run: "RecordedRun", replay: LiveReplay) -> None:
    """Print which signals differ by more than the tolerance."""
    again = open_run(replay.output)
    again.origin_ns = run.origin_ns
    counts = {one.topic: one.count for one in again.bag.topics}
    recorded = {one.topic: one.count for one in run.bag.topics if one.count}
    outputs = [topic for topic in replay.request.outputs if topic in recorded]
    for topic in outputs:
        print(f"{topic}: {counts.get(topic, 0)} messages, {recorded[topic]} recorded")
    if silent := [topic for topic in outputs if not counts.get(topic)]:
        raise CommandFailedError(f"the nodes published nothing on {list_names(silent)}")
    found = compare_runs(run, again, outputs)
    if not found.signals:
        raise CommandFailedError(
            "no message could be compared: the nodes published too little",
            help="replay a longer recording, or at a lower --rate",
        )
    beyond = [one for one in found.signals if not one.is_within(replay.tolerance)]
    within = len(found.signals) - len(beyond)
    part = f"{100 * replay.tolerance:g} %"
    print(f"signals within {part} of their span (RMS): {within} of {len(found.signals)}")
    if beyond:
        print("\n".join(signal_lines(replace(found, signals=tuple(beyond)))))
