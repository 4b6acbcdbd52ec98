"""`obk validate CONFIG...`: run every check without starting anything; repeat with `--watch`."""

import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from obk_cli.cli.config_options import (
    ColourOption,
    IgnoreOption,
    SetOption,
    make_options,
    wants_colour,
)
from obk_cli.cli.options import require_choice
from obk_cli.compiler import Options, Outcome, compile_config
from obk_cli.config.model import Stack
from obk_cli.configedit.autofix import Fixed, fix_config
from obk_cli.configedit.edited_files import (
    EditedFile,
    open_for_edit,
    print_bytes,
    report_diff,
    write_edited,
)
from obk_cli.diagnostics.diagnostic import Diagnostic, in_order
from obk_cli.diagnostics.source import SourceFile
from obk_cli.errors import EXIT_DONE, EXIT_FAILED, CommandFailedError, MisuseError
from obk_cli.files import STANDARD_INPUT, read_bytes
from obk_cli.process.signals import until_interrupt
from obk_cli.report import report_github, report_json, report_sarif, report_text, summary
from obk_cli.workspace.config_files import configs_that_include
from obk_cli.workspace.environment import MachineEnvironment

__all__ = ["EXAMPLE", "WatchedRun", "check_after_changes", "command"]

_POLL_S = 0.2
Mark = tuple[int, int] | None
"""Modification time [ns] and size of a file; None if it does not exist."""
_FORMATS = ("text", "json", "sarif", "github")

EXAMPLE = """\b
Example: obk validate config.yaml --ignore OBK4
         obk validate config.yaml --set 'robot[0].sim[0].time_step=0.001'
         obk validate configs/*.yaml --format sarif > findings.sarif
"""


def command(
    configs: Annotated[
        list[str], typer.Argument(metavar="CONFIG...", help="Config files; `-` is stdin.")
    ],
    format: Annotated[
        str, typer.Option(metavar="text|json|sarif|github", help="Output format.")
    ] = "text",
    strict: Annotated[bool, typer.Option("--strict", help="Also fail on warnings.")] = False,
    fix: Annotated[
        bool, typer.Option("--fix", help="Apply safe fixes in place and report what is left.")
    ] = False,
    diff: Annotated[
        bool, typer.Option("--diff", help="With --fix: show the changes without writing them.")
    ] = False,
    for_test: Annotated[
        bool,
        typer.Option(
            "--for-test",
            help="Also report code that may behave differently between lockstep runs.",
        ),
    ] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Check again whenever a file changes, until Ctrl-C.")
    ] = False,
    verbose: Annotated[
        bool,
        typer.Option("--verbose", help="Also show source lines and hints for info-level findings."),
    ] = False,
    ignore: IgnoreOption = None,
    set_: SetOption = None,
    color: ColourOption = "auto",
) -> None:
    """Check configs (text, wiring, model and packages) without starting anything.

    Exit code 0: no errors; 1: errors, or warnings with --strict; 2: usage error. With --watch, it
    is always 0.
    """
    require_choice("--format", format, _FORMATS)
    _check_together(configs, format, fix=fix, diff=diff, watch=watch)
    options = replace(make_options(set_, ignore), including=configs_that_include, for_test=for_test)
    colour = wants_colour(color)
    if watch:
        _watch(configs, options, colour=colour, verbose=verbose)
        raise typer.Exit(EXIT_DONE)
    if fix:
        outcomes = _fix(configs, format, options, diff=diff, colour=colour)
    else:
        outcomes = [compile_config(config, options) for config in configs]
    findings = _findings(outcomes)
    if not diff:
        paths = [outcome.path for outcome in outcomes]
        _print_report(format, paths, findings, colour=colour, verbose=verbose)
    failing = ("error", "warning") if strict else ("error",)
    failed = any(finding.severity in failing for finding in findings)
    raise typer.Exit(EXIT_FAILED if failed else EXIT_DONE)


def _check_together(configs: list[str], form: str, *, fix: bool, diff: bool, watch: bool) -> None:
    if diff and not fix:
        raise MisuseError("`--diff` needs `--fix`")
    if watch and (fix or form != "text"):
        other = "--fix" if fix else f"--format {form}"
        raise MisuseError(f"`--watch` cannot be combined with `{other}`")
    if (fix or watch) and STANDARD_INPUT in configs:
        raise MisuseError(f"`--{'fix' if fix else 'watch'}` needs files, not standard input")


def _fix(
    configs: list[str], form: str, options: Options, *, diff: bool, colour: bool
) -> list[Outcome]:
    """Apply safe fixes to the configs; the outcomes hold the findings that are left."""
    reports = [fix_file(config, options, show_only=diff, colour=colour) for config in configs]
    for report in reports:
        for line in report.lines:
            print(line, file=sys.stderr if diff or form != "text" else sys.stdout)
    return [report.outcome for report in reports]


def _watch(configs: list[str], options: Options, *, colour: bool, verbose: bool) -> None:
    def check() -> dict[Path, Mark]:
        run = WatchedRun(options)
        outcomes = [run.compile(config) for config in configs]
        print(f"[{datetime.now():%H:%M:%S}] ", end="")
        paths = [outcome.path for outcome in outcomes]
        _print_watched(paths, _findings(outcomes), colour=colour, verbose=verbose)
        return run.marks

    check_after_changes(check, _wait)


def _print_watched(
    paths: list[str], findings: tuple[Diagnostic, ...], *, colour: bool, verbose: bool
) -> None:
    print(summary(paths, findings, colour=colour))
    if findings:
        print(f"\n{report_text(findings, colour=colour, verbose=verbose)}\n")
    sys.stdout.flush()


def _findings(outcomes: list[Outcome]) -> tuple[Diagnostic, ...]:
    return in_order(finding for outcome in outcomes for finding in outcome.diagnostics)


def _print_report(
    form: str,
    paths: list[str],
    findings: tuple[Diagnostic, ...],
    *,
    colour: bool,
    verbose: bool,
) -> None:
    match form:
        case "json":
            print(report_json(paths, findings))
        case "sarif":
            print(report_sarif(findings))
        case "github":
            print(report_github(findings), end="\n" if findings else "")
        case _:
            if findings:
                print(report_text(findings, colour=colour, verbose=verbose), end="\n\n")
            print(summary(paths, findings, colour=colour))


@dataclass(frozen=True, slots=True, kw_only=True)
class FixReport:
    """What is left of a config's findings, and a line for each that was fixed or skipped."""

    outcome: Outcome
    lines: tuple[str, ...] = ()


def fix_file(config: str, options: Options, *, show_only: bool, colour: bool) -> FixReport:
    """Fix a config's files in its folder and below; with `show_only` print diffs instead.

    Raises:
        CommandFailedError: a file cannot be written; it is unchanged.
    """
    folder = (options.working_folder / config).resolve().parent
    fixed = fix_config(config, options, lambda path: path.is_relative_to(folder))
    lines = tuple(_lines(fixed, show_only=show_only))
    if show_only:
        for source, text in fixed.files:
            print_bytes(os.fsencode(report_diff(source, text, colour=colour)))
        return FixReport(outcome=fixed.before, lines=lines)
    opened = [(_reopen(source), text) for source, text in fixed.files]
    for file, text in opened:
        write_edited(file, text)
    return FixReport(outcome=fixed.after, lines=lines)


def _reopen(source: SourceFile) -> EditedFile:
    file = open_for_edit(source.path)
    if isinstance(file, Diagnostic) or file.source.text != source.text:
        raise CommandFailedError(f"`{source.path}` changed during the edit; nothing was written")
    return file


def _lines(fixed: Fixed, *, show_only: bool) -> list[str]:
    groups = (
        ("would fix" if show_only else "fixed", fixed.done),
        ("skipped because the fix would change the config's meaning:", fixed.refused),
        ("skipped because the file is outside the config's folder:", fixed.outside),
    )
    return [f"{what} {_short(finding)}" for what, findings in groups for finding in findings]


def _short(finding: Diagnostic) -> str:
    """The finding's first line and the result of its first edit."""
    first, *more = finding.fix
    now = f"now {first.text}" if first.text else "removed"
    others = f" ({len(more) + 1} times)" if more else ""
    return f"{finding}: {now}{others}"


@dataclass(slots=True)
class WatchedRun:
    """Compiles configs and records the state of every file that was read."""

    options: Options
    marks: dict[Path, Mark] = field(default_factory=dict)

    def compile(self, config: str) -> Outcome:
        """Compile one config."""
        options = self.options
        environment = MachineEnvironment(
            (options.working_folder / config).resolve().parent,
            options.working_folder,
            options.variables,
            note=self._note,
        )
        options = replace(options, read=self._read, environment=environment)
        outcome = compile_config(config, options)
        if outcome.config is not None:
            for path in _files_of(outcome.config):
                self._note(path)
        return outcome

    def _read(self, path: str) -> bytes | str:
        self._note(self.options.working_folder / path)
        return read_bytes(path)

    def _note(self, path: Path) -> None:
        """Record a file's state before reading it, to detect changes during the check."""
        if path not in self.marks:
            self.marks[path] = _mark(path)


def check_after_changes(check: Callable[[], Mapping[Path, Mark]], wait: Callable[[], None]) -> None:
    """Run `check` now and after each change to the files that it names, until interrupted."""
    with until_interrupt():
        while True:
            marks = check()
            while _marks(marks) == marks:
                wait()
            _settle(marks, wait)


def _wait() -> None:
    """Wait until the files are polled again."""
    time.sleep(_POLL_S)


def _settle(paths: Iterable[Path], wait: Callable[[], None]) -> None:
    """Wait until the files stop changing; some editors remove the old file first."""
    before = None
    while before != (now := _marks(paths)):
        before = now
        wait()


def _marks(paths: Iterable[Path]) -> dict[Path, Mark]:
    return {path: _mark(path) for path in paths}


def _mark(path: Path) -> Mark:
    try:
        state = path.stat()
    except (OSError, ValueError):
        return None
    return state.st_mtime_ns, state.st_size


def _files_of(stack: Stack) -> Iterable[Path]:
    """Paths that were tried in the search for other files, existing or not."""
    for node in stack.nodes:
        of_sims = (search for sim in node.sims for search in (sim.model, *sim.files))
        for search in (*of_sims, node.params_file, node.urdf_file):
            if search is not None:
                yield from search.tried
