"""`obk build [PKG...]`: compile the workspace's message packages into its overlay."""

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from obelisk_spec.suggestions import list_names
from obk_cli.cli.config_options import ColourOption, wants_colour
from obk_cli.cli.options import FormatOption, wants_json
from obk_cli.errors import CommandFailedError, CommandInterruptedError, MisuseError
from obk_cli.optional_deps import no_ros
from obk_cli.plan.plan import Plan
from obk_cli.process.signals import accept_interrupt
from obk_cli.ros.environment import RosEnvironment
from obk_cli.terminal import visible
from obk_cli.workspace.message_build import (
    BuildCallbacks,
    BuildOptions,
    BuildResult,
    build_workspace,
    needed_packages,
    refuse_conflicts,
    survey_of,
)
from obk_cli.workspace.overlay import import_from, overlay_prefixes, with_overlays
from obk_cli.workspace.package_index import PackageIndex, find_workspace
from obk_interfaces import (
    CommandError,
    DefinitionError,
    DefinitionProblem,
    InterfaceError,
    NoRosError,
    Progress,
)

__all__ = ["on_overlays", "report_problems", "showing_progress"]

_DOING = {
    "generate": "generated",
    "compile": "compiled",
    "link": "linked",
    "install": "installed",
}


def report_problems(problems: Iterable[DefinitionProblem], *, colour: bool) -> str:
    """Print each problem with its line, underlined at its location."""
    return "\n\n".join("\n".join(_problem(problem, colour=colour)) for problem in problems)


def _problem(problem: DefinitionProblem, *, colour: bool) -> Iterator[str]:
    red, end = ("\x1b[31m", "\x1b[0m") if colour else ("", "")
    path = _short(problem.path)
    yield f"{path}:{problem.line}:{problem.column}: {red}error{end}: {visible(problem.sentence)}"
    text = problem.path.read_text(encoding="utf-8", errors="replace").splitlines()
    line = text[problem.line - 1] if 0 < problem.line <= len(text) else ""
    if line:
        before = line[: problem.column - 1]
        indent = "".join("\t" if char == "\t" else " " for char in before)
        length = len((line[problem.column - 1 :].split() or ["x"])[0])
        yield f"  {problem.line} | {visible(line)}"
        yield f"  {'':>{len(str(problem.line))}} | {indent}{red}{'^' * length}{end}"
    if problem.help:
        yield f"  help: {visible(problem.help)}"


def _short(path: Path) -> str:
    cwd = Path.cwd()
    return str(path.relative_to(cwd)) if path.is_relative_to(cwd) else str(path)


@contextmanager
def showing_progress(*, is_terminal: bool) -> Iterator[Callable[[Progress], None]]:
    """Show progress on stderr inside the `with` block; on a terminal it is cleared when done."""
    if not is_terminal:
        yield _print_step
        return
    with ExitStack() as stack:
        shown: list[Callable[[Progress], None]] = []

        def show(step: Progress) -> None:
            if not shown:  # do not load rich if there is nothing to do
                shown.append(_open_bar(stack))
            shown[0](step)

        yield show


def _open_bar(stack: ExitStack) -> Callable[[Progress], None]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    console = Console(file=sys.stderr)
    bar = Bar(
        *columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False
    )
    stack.enter_context(bar)
    task = bar.add_task("")

    def show(step: Progress) -> None:
        text = f"{_DOING.get(step.step, step.step):<10} {step.subject}"
        bar.update(task, description=text, completed=step.done, total=step.total)

    return show


def _print_step(step: Progress) -> None:
    if step.step == "compile" and step.done == step.total:
        print(f"compiled   {step.total} units", file=sys.stderr, flush=True)
    elif step.step in ("generate", "link"):
        print(f"{_DOING[step.step]:<10} {step.subject}", file=sys.stderr, flush=True)


EXAMPLE = """\b
Example: obk build
         obk build my_msgs --clean
"""


def command(
    packages: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[PKG]...", help="Packages to build. Default: all in the workspace."
        ),
    ] = None,
    workspace: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Workspace folder. Default: the workspace that contains the current folder.",
        ),
    ] = None,
    clean: Annotated[
        bool, typer.Option("--clean", help="Remove previous build results first.")
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option(help="Number of parallel compiler processes.", show_default="processors"),
    ] = None,
    format: FormatOption = "text",
    color: ColourOption = "auto",
) -> None:
    """Compile the workspace's message packages (msg/, srv/, action/) that have changed.

    The results go into the overlay `.obk/overlay` of the workspace, where `obk launch` finds them.
    For other programs, run `. .obk/setup.sh` first. If ROS 2 is sourced and colcon is installed,
    colcon builds all packages, not only those with messages. An interrupted build leaves the
    overlay unchanged.
    """
    is_json, colour = wants_json(format), wants_colour(color, to_stderr=True)
    if jobs is not None and jobs < 1:
        raise MisuseError(f"`--jobs {jobs}`: expected a number of at least 1")
    if workspace is not None and not workspace.is_dir():
        raise MisuseError(f"`--workspace {workspace}`: folder not found")
    options = BuildOptions(
        environment=dict(os.environ), names=tuple(packages or ()), is_clean=clean, jobs=jobs
    )
    folder = find_workspace(workspace or Path.cwd())
    try:
        built = build_shown(folder, options, colour=colour)
    except _DefinitionsWrongError as error:
        if is_json:
            print(
                json.dumps({"problems": [_data(problem) for problem in error.problems]}, indent=1)
            )
        raise
    print(json.dumps(_result(built), indent=1) if is_json else "\n".join(_result_lines(built)))


class _DefinitionsWrongError(CommandFailedError):
    """Invalid message definitions in the workspace; holds the problems as values."""

    def __init__(self, message: str, problems: Sequence[DefinitionProblem]) -> None:
        super().__init__(message)
        self.problems = problems


def build_shown(workspace: Path, options: BuildOptions, *, colour: bool) -> BuildResult:
    """Build a workspace, with the progress on stderr.

    Raises:
        CommandFailedError: the build failed; invalid definitions are printed on stderr.
        CommandInterruptedError: Ctrl-C was pressed.
    """
    is_terminal = sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
    with _as_command_error(colour=colour), showing_progress(is_terminal=is_terminal) as show:
        return build_workspace(workspace, options, BuildCallbacks(on_progress=show, on_note=_note))


@contextmanager
def _as_command_error(*, colour: bool) -> Iterator[None]:
    try:
        yield
    except DefinitionError as error:
        print(report_problems(error.problems, colour=colour), end="\n\n", file=sys.stderr)
        count = len(error.problems)
        summary = (
            "invalid message definition" if count == 1 else f"{count} invalid message definitions"
        )
        raise _DefinitionsWrongError(f"{summary}; nothing was built", error.problems) from error
    except CommandError as error:
        if error.output:
            print(error.output.rstrip(), end="\n\n", file=sys.stderr)
        raise CommandFailedError(f"{error.sentence}; the overlay is unchanged") from error
    except NoRosError as error:
        raise no_ros(error) from error
    except InterfaceError as error:
        raise CommandFailedError(str(error)) from error
    except OSError as error:
        raise CommandFailedError(f"the overlay cannot be written: {error}") from error
    except KeyboardInterrupt as error:
        accept_interrupt()
        raise CommandInterruptedError("interrupted; the overlay is unchanged") from error


def _note(sentence: str) -> None:
    print(sentence, file=sys.stderr, flush=True)


def _data(problem: DefinitionProblem) -> dict[str, object]:
    return {
        "path": str(problem.path),
        "line": problem.line,
        "column": problem.column,
        "message": problem.sentence,
        "help": problem.help or None,
    }


def _result(built: BuildResult) -> dict[str, object]:
    return {
        "workspace": str(built.workspace),
        "overlay": str(built.overlay),
        "builder": built.builder,
        "prefixes": [str(prefix) for prefix in built.prefixes],
        "built": list(built.built),
        "unchanged": list(built.unchanged),
        "installed": list(built.installed),
        "removed": list(built.removed),
        "duration_s": round(built.duration_s, 3),
    }


def _result_lines(built: BuildResult) -> Iterator[str]:
    if not (built.built or built.unchanged or built.installed or built.removed):
        yield f"{built.workspace} has no message packages; create one with `obk new msgs my_msgs`"
        return
    if built.built:
        yield f"built {list_names(built.built)} in {built.duration_s:.1f} s"
    if built.unchanged:
        yield f"unchanged: {list_names(built.unchanged)}"
    if built.installed:
        yield f"already installed with the same definitions: {list_names(built.installed)}"
    if built.removed:
        yield f"removed: {list_names(built.removed)}"
    if built.prefixes:
        yield f"overlay: {built.overlay}"


def on_overlays(
    folder: Path, environment: RosEnvironment, plan: Plan, *, may_build: bool, color: str
) -> tuple[PackageIndex, RosEnvironment]:
    """Return the packages for the plan of a config in `folder`, and the environment to find them
    in.

    Message packages are up to date, and this process finds them too. With `may_build` off, what is
    missing or stale is reported on stderr. `color` is the value of the option.

    Raises:
        CommandFailedError: a package cannot be compiled.
    """
    index = PackageIndex.around(folder, Path.cwd(), environment.variables)
    workspaces, needed = index.workspaces, needed_packages(plan, index)
    for place, workspace in reversed([*enumerate(workspaces)]):
        # The shell's environment: entries added for nodes must not reach compilers.
        shell = with_overlays(os.environ, overlay_prefixes(workspaces[place + 1 :]))
        if may_build:
            _build(workspace, shell, needed, colour=wants_colour(color, to_stderr=True))
        else:
            _warn_of_stale(workspace, shell, needed)
    overlays = overlay_prefixes(workspaces)
    import_from(overlays)
    variables = with_overlays(environment.variables, overlays)
    packages = PackageIndex.around(folder, Path.cwd(), variables)
    if packages == index:  # the index already has the sources
        packages = index
    return packages, replace(environment, variables=variables)


def _build(
    workspace: Path, environment: Mapping[str, str], needed: frozenset[str], *, colour: bool
) -> None:
    options = BuildOptions(environment=environment, only_messages=True, needed=needed)
    built = build_shown(workspace, options, colour=colour)
    if built.built:
        print(f"built {list_names(built.built)} in {built.duration_s:.1f} s", file=sys.stderr)


def _warn_of_stale(workspace: Path, environment: Mapping[str, str], needed: frozenset[str]) -> None:
    try:
        survey = survey_of(workspace, environment)
        refuse_conflicts(survey, needed)
    except InterfaceError as error:
        raise CommandFailedError(str(error)) from error
    for state, text in (("missing", "not compiled"), ("changed", "changed since compiled")):
        names = [one.name for one in survey.stale if one.state == state]
        if names:
            print(
                f"warning: {list_names(names)}: {text} (not built because of `--no-build`)",
                file=sys.stderr,
            )
