"""A build of message packages for a person: its advance, and what is wrong with definitions.

The advance is a bar on a terminal, else a line for each step of each package. All of it
goes to stderr.
"""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from obk_cli.report.escapes import visible
from obk_interfaces import DefinitionProblem, Progress

__all__ = ["report_problems", "showing_progress"]

_DOING = {
    "generate": "generated",
    "compile": "compiled",
    "link": "linked",
    "install": "installed",
}


def report_problems(problems: Iterable[DefinitionProblem], *, colour: bool) -> str:
    """Every problem with its line, the place underlined."""
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
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)


@contextmanager
def showing_progress(*, is_terminal: bool) -> Iterator[Callable[[Progress], None]]:
    """While entered, what is given is shown on stderr; on a terminal nothing of it is left."""
    if not is_terminal:
        yield _print_step
        return
    with ExitStack() as stack:
        shown: list[Callable[[Progress], None]] = []

        def show(step: Progress) -> None:
            if not shown:  # where nothing is to be done, rich is not even loaded
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
        words = f"{_DOING.get(step.step, step.step):<10} {step.subject}"
        bar.update(task, description=words, completed=step.done, total=step.total)

    return show


def _print_step(step: Progress) -> None:
    if step.step == "compile" and step.done == step.total:
        print(f"compiled   {step.total} units", file=sys.stderr, flush=True)
    elif step.step in ("generate", "link"):
        print(f"{_DOING[step.step]:<10} {step.subject}", file=sys.stderr, flush=True)
