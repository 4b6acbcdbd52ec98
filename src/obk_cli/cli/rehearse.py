"""`obk rehearse CONFIG`: delay, freeze and kill each node, and check how the stack reacts."""

import json
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from io import StringIO
from itertools import count
from pathlib import Path
from typing import Annotated, Any, Final, cast, get_args

import typer

from obelisk_spec.suggestions import did_you_mean, with_number
from obk_cli.cli.config_options import (
    ColourOption,
    IgnoreOption,
    SetOption,
    make_options,
    valid_plan,
    wants_colour,
)
from obk_cli.cli.options import FormatOption, require_choice, wants_json
from obk_cli.compiler import compile_config
from obk_cli.config.model import refuse_hardware
from obk_cli.errors import EXIT_DONE, EXIT_FAILED, MisuseError
from obk_cli.faultinject.expectations import FAULTS, Case, Fault, make_cases
from obk_cli.faultinject.verdict import Verdict
from obk_cli.launch.event_lines import short_name
from obk_cli.launch.options import require_libraries
from obk_cli.launch.process_groups import Unit, share_of, units_of
from obk_cli.optional_deps import require_ros
from obk_cli.plan.plan import OnCrash, Plan
from obk_cli.runs.registry import select_nodes

__all__ = ["HEAD", "rehearsal_json", "rehearsal_table", "rehearsal_text"]

EXAMPLE = """\b
Example: obk rehearse examples/dummy/dummy.yaml
         obk rehearse config.yaml --on-crash restart --node control --fault kill,freeze
"""
OBK = (sys.executable, "-P", "-m", "obk_cli.cli.main")
QUIETLY = ("--format=json", "--quiet", "--color=never", "--network=localhost", "--keep=1000000")
"""Options of a rehearsal's launches; all of their logs are kept as evidence."""


def command(
    config: Annotated[str, typer.Argument(metavar="CONFIG", help="Config file.")],
    on_crash: Annotated[
        str,
        typer.Option(
            metavar="|".join(get_args(OnCrash)),
            help="Policy for nodes without their own `on_crash`, as in `obk launch`.",
        ),
    ] = "stop",
    node: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Test only this node, or the nodes of this section; may be repeated.",
        ),
    ] = None,
    fault: Annotated[
        str, typer.Option(metavar=",".join(FAULTS), help="Faults to inject into each node.")
    ] = ",".join(FAULTS),
    composed: Annotated[
        bool, typer.Option("--composed", help="Run the Python nodes in one process.")
    ] = False,
    domain: Annotated[
        int | None, typer.Option(min=0, max=232, help="ROS domain. Default: a free one.")
    ] = None,
    format: FormatOption = "text",
    set_: SetOption = None,
    ignore: IgnoreOption = None,
    color: ColourOption = "auto",
) -> None:
    """Test how a stack with a simulated robot reacts when its nodes fail.

    Each node is delayed (suspended for 1 s, which must have no effect), frozen and killed. The
    launcher's reaction is compared with the node's `on_crash` policy. The stack is visible on this
    host only. Exit code 0: all reactions are as expected; 1: one is not, or the config has errors.
    """
    is_json = wants_json(format)
    if config == "-":
        raise MisuseError("`obk rehearse` starts the stack more than once, so it needs a file")
    require_choice("--on-crash", on_crash, get_args(OnCrash))
    faults = _faults(fault)
    require_ros()
    outcome = compile_config(config, make_options(set_, ignore))
    plan = valid_plan(outcome, color)
    assert outcome.config is not None  # a plan exists only if a config does

    refuse_hardware(
        outcome.config,
        "a rehearsal kills and freezes the nodes that control the robot",
        help="set `is_simulated: true` and a `sim` block, in the config or with `--set`",
    )
    require_libraries(plan, share_of(plan, None, None))
    cases = make_cases(
        _units(plan, config, is_composed=composed),
        faults=faults,
        on_crash=cast(OnCrash, on_crash),
        nodes=_nodes(plan, node or ()),
    )
    options = [*QUIETLY, f"--on-crash={on_crash}", *(["--composed"] if composed else [])]
    options += [f"--set={value}" for value in set_ or ()]
    options += [f"--ignore={code}" for code in ignore or ()]
    verdicts = _rehearse(plan, cases, (config, *options), domain)
    print(_report(verdicts, is_json=is_json, colour=wants_colour(color)))
    raise typer.Exit(EXIT_DONE if all(verdict.is_right for verdict in verdicts) else EXIT_FAILED)


def _faults(text: str) -> tuple[Fault, ...]:
    faults = tuple(fault.strip() for fault in text.split(","))
    for fault in faults:
        require_choice("--fault", fault, FAULTS)
    return cast(tuple[Fault, ...], faults)


def _nodes(plan: Plan, names: Sequence[str]) -> frozenset[str]:
    """Full names of the selected nodes."""
    known = [node.full_name for node in plan.nodes]
    selected: set[str] = set()
    for name in names:
        found = select_nodes(name, known)
        if not found:
            raise MisuseError(
                f"`--node {name}`: no such node in the stack",
                help=did_you_mean(name, [*known, *map(short_name, known)]),
            )
        selected.update(found)
    return frozenset(selected)


def _units(plan: Plan, config: str, *, is_composed: bool) -> tuple[Unit, ...]:
    """The processes that a launch starts for the plan."""
    devices = {node.device for node in plan.nodes}
    if not is_composed:
        return units_of(plan, devices=devices)

    from obk_cli.launch.commands import composable, find_executables
    from obk_cli.workspace.package_index import PackageIndex

    folder = Path(config).resolve().parent
    packages = PackageIndex.around(folder, Path.cwd(), dict(os.environ))
    together = composable(plan.nodes, find_executables(plan.nodes, packages))
    return units_of(plan, devices=devices, together=together)


def _rehearse(
    plan: Plan, cases: Sequence[Case], arguments: Sequence[str], domain: int | None
) -> tuple[Verdict, ...]:
    from obk_cli.faultinject.runner import (
        LaunchSettings,
        make_rehearsal_folder,
        refuse_running,
        run_cases,
    )
    from obk_cli.ros.domains import free_domain
    from obk_cli.runs.folder import runs_folder

    runs = runs_folder(os.environ)
    refuse_running(runs, plan.name)
    home = make_rehearsal_folder(runs.parent / "rehearsals", plan.name)
    numbers = count(1)

    def on_case(case: Case) -> None:
        _progress(f"[{next(numbers)}/{len(cases)}] {case.fault} {short_name(case.unit.name)}")

    with nullcontext(domain) if domain is not None else free_domain() as own:
        print(f"rehearsing {plan.name} in ROS domain {own}, logs in {home}", file=sys.stderr)
        variables = {**os.environ, "OBK_HOME": str(home), "ROS_DOMAIN_ID": str(own)}
        settings = LaunchSettings(
            command=(*OBK, "launch", *arguments), environment=variables, runs=runs_folder(variables)
        )
        try:
            return run_cases(cases, settings, on_case)
        finally:
            _progress("")


def _progress(text: str) -> None:
    """Print progress, on a terminal in one line that is overwritten."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)
    elif text:
        print(text, file=sys.stderr)


def _report(verdicts: Sequence[Verdict], *, is_json: bool, colour: bool) -> str:

    if is_json:
        return rehearsal_json(verdicts)
    if colour and sys.stdout.isatty():
        return rehearsal_table(verdicts, shutil.get_terminal_size().columns)
    return rehearsal_text(verdicts)


HEAD: Final = ("node", "fault", "expected", "observed", "detected [s]", "settled [s]", "")
"""Titles of the columns; the last one holds the verdict."""
_NUMBERS: Final = (4, 5)
_RIGHT: Final = "ok"
_WRONG: Final = "FAILED"


def rehearsal_text(verdicts: Sequence[Verdict]) -> str:
    """A plain table, details of unexpected reactions, and a summary."""
    cells = [HEAD, *map(_cells, verdicts)]
    widths = [max(len(verdict[column]) for verdict in cells) for column in range(len(HEAD))]
    lines = ["  ".join(_aligned(verdict, widths)).rstrip() for verdict in cells]
    return "\n".join((*lines, *_below(verdicts)))


def rehearsal_table(verdicts: Sequence[Verdict], width: int) -> str:
    """The same, drawn and colored for a terminal of this width."""
    from rich import box  # rich is slow to import
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column, title in enumerate(HEAD):
        table.add_column(Text(title), justify="right" if column in _NUMBERS else "left")
    for verdict in verdicts:
        *cells, mark = _cells(verdict)
        style = "green" if verdict.is_right else "bold red"
        table.add_row(*map(Text, cells), Text(mark, style))
    console = Console(file=StringIO(), width=width, force_terminal=True, color_system="standard")
    with console.capture() as capture:
        console.print(table)
    drawn = (line for line in capture.get().splitlines() if line.strip())
    return "\n".join((*drawn, *_below(verdicts)))


def rehearsal_json(verdicts: Sequence[Verdict]) -> str:
    """The verdicts as JSON."""
    is_right = all(verdict.is_right for verdict in verdicts)
    return json.dumps({"ok": is_right, "rows": [_data(verdict) for verdict in verdicts]}, indent=1)


def _cells(verdict: Verdict) -> tuple[str, ...]:
    return (
        short_name(verdict.case.unit.name),
        verdict.case.fault,
        verdict.case.expectation.summary,
        verdict.observed,
        _seconds(verdict.detected_s, 3),
        _seconds(verdict.settled_s, 1),
        _RIGHT if verdict.is_right else _WRONG,
    )


def _seconds(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _aligned(cells: Sequence[str], widths: Sequence[int]) -> Iterator[str]:
    for column, (cell, width) in enumerate(zip(cells, widths, strict=True)):
        yield cell.rjust(width) if column in _NUMBERS else cell.ljust(width)


def _below(verdicts: Sequence[Verdict]) -> Iterator[str]:
    wrong = [verdict for verdict in verdicts if not verdict.is_right]
    for verdict in wrong:
        yield ""
        yield f"{verdict.case.fault} {short_name(verdict.case.unit.name)}:"
        yield from (f"  {fault}" for fault in verdict.faults)
        if verdict.run is not None:
            yield f"  see {verdict.run / 'launch.log'}"
    yield ""
    expectations = with_number(len(verdicts), "expectation")
    yield f"{len(verdicts) - len(wrong)} of {expectations} met" if wrong else f"{expectations} met"


def _data(verdict: Verdict) -> dict[str, Any]:
    unit, expectation = verdict.case.unit, verdict.case.expectation
    return {
        "process": unit.name,
        "nodes": list(unit.node_names),
        "fault": verdict.case.fault,
        "expected": expectation.summary,
        "observed": verdict.observed,
        "detected_s": verdict.detected_s,
        "settled_s": verdict.settled_s,
        "ok": verdict.is_right,
        "faults": list(verdict.faults),
        "run": None if verdict.run is None else str(verdict.run),
    }
