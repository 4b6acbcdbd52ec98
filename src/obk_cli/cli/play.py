"""`obk play FILE|RUN`: replay a recording, or run nodes on recorded inputs."""

import json
import os
import sys
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Final

import typer

from obelisk_recordings.find import find_recording
from obelisk_spec.suggestions import with_number
from obk_cli.cli.options import (
    TIMEOUT_S,
    DomainOption,
    RunArgument,
    TimeoutOption,
    TopicsOption,
    graph_target,
    note_if_incomplete,
    print_note,
    require_positive,
    with_types,
)
from obk_cli.errors import EXIT_FAILED, EXIT_INTERRUPTED, CommandFailedError, MisuseError
from obk_cli.runs.folder import runs_folder

if TYPE_CHECKING:
    from obelisk_recordings.run import RecordedRun
    from obk_cli.plan.plan import Plan, PlannedNode

__all__ = ["EXAMPLE", "command"]

EXAMPLE = """\b
Example: obk play dummy --topic imu --topic est --rate 0.5
         obk play dummy --into dummy.yaml --nodes estimation
         obk play dummy --into dummy.yaml --nodes estimation --real-time --rate 0.5
"""
_PROGRAM: Final = "obk_testing.replay"
_TOLERANCE: Final = 0.05


def command(
    recording: RunArgument,
    topic: TopicsOption = None,
    rate: Annotated[
        float,
        typer.Option(
            help="Playback speed, relative to real time; with --into, requires --real-time."
        ),
    ] = 1.0,
    into: Annotated[
        str | None,
        typer.Option(metavar="CONFIG", help="Run nodes of this config on recorded inputs."),
    ] = None,
    nodes: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NODE",
            help="Nodes to run from the --into config, by name or section; may be repeated.",
        ),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PATH=VALUE", help="Override a value in the --into config."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Recording that --into writes; replaces only an earlier replay.",
        ),
    ] = None,
    real_time: Annotated[
        bool,
        typer.Option("--real-time", help="Run the --into nodes as processes, in real time."),
    ] = False,
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="FRACTION",
            help="With --real-time: accepted RMS difference, as a fraction of each signal's span. "
            "Default: 0.05.",
        ),
    ] = None,
    allow_hardware: Annotated[
        bool,
        typer.Option(
            "--allow-hardware",
            help="Also publish topics that command robots, or that a running robot's stack uses.",
        ),
    ] = False,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
) -> None:
    """Replay a recording in real time.

    Topics that command a robot are left out unless --allow-hardware is given. If a robot in the ROS
    domain subscribes to one of the other topics, or a robot is running there and another node
    publishes one, the command exits with an error before publishing.

    With --into, nodes of a config run on the recorded inputs instead, in lockstep and in simulated
    time. Repeating the replay gives bit-identical results. The nodes are isolated: no other process
    receives their messages, and no robot moves. Their output is recorded and compared with the
    original recording. Unchanged code gives bit-identical output if the recording was made in
    lockstep, by `obk test --keep-all`.

    With --real-time, the nodes run as processes and follow the recorded time, which is published on
    /clock. They run in a ROS domain of their own unless --domain is given. Their output is compared
    within a tolerance. Nodes and inputs that command a robot need --allow-hardware.
    """
    require_positive("--rate", rate)
    if into is None and (nodes or set_ or output):
        raise MisuseError("`--nodes`, `--set` and `--output` need `--into CONFIG`")
    if into is not None and not nodes:
        raise MisuseError("`--into` needs `--nodes`", help="such as `--nodes estimation`")
    if real_time and into is None:
        raise MisuseError("`--real-time` needs `--into CONFIG`")
    if tolerance is not None and not real_time:
        raise MisuseError("`--tolerance` needs `--real-time`")
    if tolerance is not None and not tolerance >= 0.0:
        raise MisuseError(f"`--tolerance {tolerance:g}`: expected a number of at least 0")
    if into is not None and not real_time and rate != 1.0:
        raise MisuseError(
            "`--rate` with `--into` needs `--real-time`: lockstep runs have no playback speed"
        )

    from obk_cli.optional_deps import require_extra, require_ros

    require_extra("mcap", "record")
    require_ros()

    from obelisk_recordings.run import open_run, topic_named

    run = open_run(find_recording(runs_folder(os.environ), recording))
    note_if_incomplete(run)
    topics = [topic_named(name, run.topics) for name in topic or ()]
    if into is not None:
        target = output or Path(f"{run.name}_replay.mcap")
        _require_replaceable(target, run)
        what = _replayed(run, into, nodes or (), set_, topics, target)
        if not real_time:
            raise typer.Exit(_replay(run, what))
        _replay_live(
            run,
            what,
            speed=rate,
            tolerance=_TOLERANCE if tolerance is None else tolerance,
            domain=domain,
            may_move=allow_hardware,
            wait_s=timeout,
        )
        return
    _publish(run, topics, rate, domain, timeout, may_move=allow_hardware)


def _require_replaceable(path: Path, run: "RecordedRun") -> None:
    """Allow the output to replace only an earlier replay, never the run itself.

    Raises:
        MisuseError: something else is there.
    """
    from obelisk_recordings.bag import RecordingError
    from obelisk_recordings.run import open_run

    if not path.exists():
        return
    if path.samefile(run.path):
        raise MisuseError(f"`--output {path}` is the recording itself", help="choose another file")
    try:
        is_replay = path.is_file() and "replay" in open_run(path).metadata.get("obelisk", {})
    except RecordingError:
        is_replay = False
    if not is_replay:
        raise MisuseError(
            f"`--output {path}` exists and is not a replay", help="choose another file"
        )


def _publish(
    run: "RecordedRun",
    named: Sequence[str],
    speed: float,
    domain: int | None,
    timeout_s: float,
    *,
    may_move: bool,
) -> None:
    from obk_cli.record.play import play, playable_topics

    topics, left_out = playable_topics(run, named, may_move=may_move)
    for name in left_out:
        print_note(f"skipping {name}: it commands a robot")
    target = with_types(graph_target(domain, timeout_s))
    played = play(
        run, topics, target, speed=speed, may_move=may_move, wait_s=timeout_s, note=print_note
    )
    for name, count in played.counts.items():
        print(f"{name}  {with_number(count, 'message')}")
    total = with_number(sum(played.counts.values()), "message")
    print(f"published {total} in {played.seconds:.1f} s")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Replayed:
    """Nodes of a config, their recorded inputs, and their outputs."""

    config: str
    overrides: list[str]
    plan: "Plan"
    chosen: "list[PlannedNode]"
    inputs: list[str]
    outputs: list[str]
    output: Path


def _replayed(
    run: "RecordedRun",
    config: str,
    nodes: Sequence[str],
    overrides: list[str] | None,
    named: Sequence[str],
    output: Path,
) -> _Replayed:
    from obk_cli.cli.config_options import make_options, valid_plan
    from obk_cli.compiler import compile_config

    plan = valid_plan(compile_config(config, make_options(overrides, None)), "auto")
    chosen = [*_chosen(plan, nodes)]
    published = {end.topic for node in chosen for end in node.publishes}
    return _Replayed(
        config=config,
        overrides=overrides or [],
        plan=plan,
        chosen=chosen,
        inputs=[*_inputs(run, chosen, published, named)],
        outputs=sorted(published),
        output=output,
    )


def _replay_live(
    run: "RecordedRun",
    what: _Replayed,
    *,
    speed: float,
    tolerance: float,
    domain: int | None,
    may_move: bool,
    wait_s: float,
) -> None:
    from obk_cli.cli.play_live import LiveReplay, refuse_commands, replay_live
    from obk_cli.cli.play_nodes import NodesRequest

    inputs = what.inputs
    if not may_move:
        inputs = refuse_commands(what.plan, run, what.chosen, inputs)
    request = NodesRequest(
        config=what.config,
        overrides=what.overrides,
        nodes=[node.full_name for node in what.chosen],
        outputs=what.outputs,
    )
    replay = LiveReplay(
        request=request,
        inputs=inputs,
        output=what.output,
        speed=speed,
        tolerance=tolerance,
        domain=domain,
        may_move=may_move,
        wait_s=wait_s,
    )
    replay_live(run, replay)


def _replay(run: "RecordedRun", what: _Replayed) -> int:
    """Run the nodes in lockstep, in a process of their own, and compare; return the exit code."""
    from obk_cli.cli.test import lockstep_environment
    from obk_cli.optional_deps import require_extra
    from obk_cli.process.child_process import run_in_foreground

    require_extra("pytest", "test")
    request = {
        "config": str(Path(what.config).resolve()),
        "overrides": what.overrides,
        "without": [one.full_name for one in what.plan.nodes if one not in what.chosen],
        "recording": str(run.path),
        "inputs": what.inputs,
        "outputs": what.outputs,
        "output": str(what.output),
    }
    folder = Path(what.config).resolve().parent
    environment = lockstep_environment(folder, what.plan, may_build=True, color="auto")
    arguments = [sys.executable, "-m", _PROGRAM, json.dumps(request)]
    code = run_in_foreground(arguments, environment)
    if code != 0:
        return EXIT_INTERRUPTED if code is None else EXIT_FAILED
    names = ", ".join(node.full_name for node in what.chosen)
    print(f"ran {names} on {', '.join(what.inputs)}: {what.output}")
    counts = {one.topic: one.count for one in run.bag.topics}
    _compare(run, what.output, [name for name in what.outputs if counts.get(name)])
    return 0


def _chosen(plan: "Plan", names: Sequence[str]) -> "Iterator[PlannedNode]":
    """The nodes selected by node name or section.

    Raises:
        MisuseError: a name matches no node.
    """
    from obelisk_spec.suggestions import ask_for, near_names, there_is

    known = {word for one in plan.nodes for word in (one.full_name, one.node, one.section)}
    for name in names:
        if name not in known:
            raise MisuseError(
                f"`--nodes {name}`: no node has that name or section",
                help=ask_for(near_names(name, sorted(known)))
                or there_is(one.node for one in plan.nodes),
            )
    for one in plan.nodes:
        if {one.full_name, one.node, one.section} & set(names):
            yield one


def _inputs(
    run: "RecordedRun",
    nodes: "Sequence[PlannedNode]",
    published: Collection[str],
    named: Sequence[str],
) -> Iterator[str]:
    """The recorded topics that the nodes subscribe to and do not publish themselves.

    Raises:
        CommandFailedError: the recording has no messages for the nodes.
        MisuseError: a named topic is not a recorded input of the nodes.
    """
    from obelisk_spec.suggestions import list_names

    wanted = dict.fromkeys(
        end.topic for node in nodes for end in node.subscribes if end.topic not in published
    )
    counts = {one.topic: one.count for one in run.bag.topics}
    recorded = [name for name in wanted if counts.get(name)]
    for name in named:
        if name not in recorded:
            raise MisuseError(
                f"`--topic {name}`: it is not a recorded input of these nodes",
                help=f"the nodes subscribe to {list_names(recorded) or 'nothing in the recording'}",
            )
    if not recorded:
        raise CommandFailedError(
            f"{run.path} has no messages for the selected nodes",
            help=f"they subscribe to {list_names([*wanted]) or 'nothing'}",
        )
    for name in wanted:
        if name not in recorded:
            print_note(f"{name} is not in the recording")
    yield from (name for name in recorded if not named or name in named)


def _compare(run: "RecordedRun", output: Path, topics: Sequence[str]) -> None:
    """Print how the outputs differ from the recorded ones."""
    from obelisk_recordings.run import open_run
    from obk_cli.cli.diff import difference_lines
    from obk_cli.record.compare import compare_runs, first_different_message

    with TemporaryDirectory(prefix="obk-play-") as folder:
        again = open_run(output) if run.is_lockstep else _as_recorded(run, output, Path(folder))
        are_same = True
        for topic in topics:
            found = first_different_message(run, again, topic)
            are_same = are_same and found.at_s is None
            print(f"{topic}: {found}")
        if not are_same:
            print("\n".join(difference_lines(compare_runs(run, again, topics))))


def _as_recorded(run: "RecordedRun", output: Path, folder: Path) -> "RecordedRun":
    """Copy the outputs to a folder, with the times at which the recorded nodes' clock showed them.

    A launch has another time base than the replay, which is in simulated time.
    """
    from obelisk_recordings.clock import RecordedClock
    from obelisk_recordings.run import open_run
    from obk_cli.record.rewrite import rewrite

    again, clock = open_run(output), RecordedClock(run)
    shift_ns = int(again.metadata["obelisk"]["shift_ns"])
    path = folder / output.name
    rewrite(again, path, again.topics, lambda ns: clock.published_ns(ns + shift_ns), {})
    copied = open_run(path)
    copied.origin_ns = run.origin_ns
    return copied
