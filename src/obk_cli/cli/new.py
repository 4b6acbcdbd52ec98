"""`obk new controller|estimator NAME`: a package that runs, or a node more in the one around."""

import os
import shutil
import sys
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from obk_cli.adapters.packages import PackageIndex
from obk_cli.adapters.taken_names import owner_of_module, owner_of_package
from obk_cli.cli.new_target import Place, find_place, find_root, read_text
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.resources import resource_folder
from obk_cli.scaffold.compose import (
    LAYERS,
    Composition,
    PackageTexts,
    compose_addition,
    compose_package,
)
from obk_cli.scaffold.decide import Decision, conflicts, decide
from obk_cli.scaffold.describe import Outcome, describe_json, describe_text
from obk_cli.scaffold.names import Problem
from obk_cli.scaffold.questions import Answers, Question, check_answers
from obk_cli.scaffold.render import read_templates
from obk_cli.scaffold.write import read_existing, write_decisions

__all__ = ["app"]

app = typer.Typer(
    name="new",
    help="Make a ROS 2 package from a template, or add a node to the package you stand in.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)

Name = Annotated[
    str, typer.Argument(metavar="NAME", help="Name of the package and its node, lower snake case.")
]
CtrlMsg = Annotated[str, typer.Option("--ctrl-msg", help="Control message type.")]
EstMsg = Annotated[str, typer.Option("--est-msg", help="State estimate message type.")]
SensorMsg = Annotated[str, typer.Option("--sensor-msg", help="Sensor message type.")]
Dest = Annotated[
    Path | None,
    typer.Option("--dest", help="Folder for the package.", show_default="src/ if there, else ."),
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Show what would be made, make nothing.")]
Force = Annotated[bool, typer.Option("--force", help="Replace files that are there.")]
Format = Annotated[Literal["text", "json"], typer.Option("--format", help="Form of the result.")]


@app.command("controller", epilog="Example: obk new controller my_controller")
def new_controller(
    name: Name,
    ctrl_msg: CtrlMsg = "PositionSetpoint",
    est_msg: EstMsg = "EstimatedState",
    dest: Dest = None,
    dry_run: DryRun = False,
    force: Force = False,
    format: Format = "text",
) -> None:
    """Make a controller: state estimates in, control messages out."""
    question = Question(kind="controller", name=name, ctrl_msg=ctrl_msg, est_msg=est_msg)
    _run(question, dest, dry_run=dry_run, force=force, form=format)


@app.command("estimator", epilog="Example: obk new estimator my_estimator --sensor-msg ObkImu")
def new_estimator(
    name: Name,
    est_msg: EstMsg = "EstimatedState",
    sensor_msg: SensorMsg = "JointEncoders",
    dest: Dest = None,
    dry_run: DryRun = False,
    force: Force = False,
    format: Format = "text",
) -> None:
    """Make an estimator: sensor messages in, state estimates out."""
    question = Question(kind="estimator", name=name, est_msg=est_msg, sensor_msg=sensor_msg)
    _run(question, dest, dry_run=dry_run, force=force, form=format)


def _run(question: Question, dest: Path | None, *, dry_run: bool, force: bool, form: str) -> None:
    place = find_place(dest)
    answers = _answer(question, place)
    root = find_root(place, answers.node)
    composition = _compose(answers, root, is_package=place.package is not None)
    paths = [file.path for file in (*composition.files, *composition.edits)]
    decisions = decide(
        composition.files,
        read_existing(root, paths),
        edits=composition.edits,
        force=force,
    )
    _refuse_conflicts(root, decisions)
    if not dry_run:
        _write(root, decisions)
    outcome = Outcome(
        answers=answers,
        folder=_short(root),
        decisions=decisions,
        dry_run=dry_run,
        programs=_programs(),
    )
    typer.echo(describe_json(outcome) if form == "json" else describe_text(outcome))


def _answer(question: Question, place: Place) -> Answers:
    if place.package is not None:
        answers = check_answers(question, owner_of=owner_of_module)
        return _accept(answers).in_package(place.package.name)
    owner_of = partial(
        owner_of_package,
        own_folder=place.folder / question.name,
        index=PackageIndex.around(place.folder, Path.cwd(), os.environ),
    )
    return _accept(check_answers(question, owner_of=owner_of))


def _accept(answers: Answers | tuple[Problem, ...]) -> Answers:
    if isinstance(answers, Answers):
        return answers
    raise _misuse(answers)


def _misuse(problems: Iterable[Problem]) -> MisuseError:
    """All problems in one error; the last one's help goes where an error's help stands."""
    *others, last = problems
    lines = [f"{problem.sentence} ({problem.help})" for problem in others]
    return MisuseError("\n".join([*lines, last.sentence]), help=last.help)


def _compose(answers: Answers, root: Path, *, is_package: bool) -> Composition:
    folder = resource_folder("templates")
    templates = read_templates(folder / layer for layer in LAYERS[answers.kind])
    if not is_package:
        return compose_package(answers, templates)
    texts = PackageTexts(
        package_xml=read_text(root / "package.xml"),
        setup_py=read_text(root / "setup.py"),
    )
    composition = compose_addition(answers, templates, texts)
    if isinstance(composition, Problem):
        raise CommandFailedError(composition.sentence, help=composition.help)
    return composition


def _refuse_conflicts(root: Path, decisions: Iterable[Decision]) -> None:
    stopped = conflicts(decisions)
    if stopped:
        lines = "\n".join(f"  {decision.file.path}: {decision.reason}" for decision in stopped)
        raise CommandFailedError(
            f"nothing was made; in {_short(root)} there is in the way:\n{lines}",
            help="choose another name or --dest; --force replaces ordinary files",
        )


def _write(root: Path, decisions: Iterable[Decision]) -> None:
    try:
        write_decisions(root, decisions)
    except OSError as fault:
        raise CommandFailedError(f"{root} cannot be written, nothing was made: {fault}") from fault


def _short(path: Path) -> str:
    """As the user would type it from here."""
    here, full = Path.cwd(), path.resolve()
    return str(full.relative_to(here)) if full.is_relative_to(here) else str(full)


def _programs() -> str:
    """What stands in front of `python` and `obk` here: nothing when they are found by name."""
    folder = Path(sys.executable).parent
    found = shutil.which("python")
    return "" if found and Path(found).parent == folder else f"{_short(folder)}/"
