"""`obk validate --fix`: the certain cures carried out, shown or written, and told."""

import os
from dataclasses import dataclass

from obk_cli.cli.edit_files import EditedFile, open_for_edit, print_bytes, write_edited
from obk_cli.compiler import Options, Outcome
from obk_cli.configedit.autofix import Fixed, fix_config
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import SourceFile
from obk_cli.errors import CommandFailedError
from obk_cli.report.diff import report_diff

__all__ = ["FixReport", "fix_file"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FixReport:
    """What is left of a config's findings, and a line for each that was cured or left."""

    outcome: Outcome
    lines: tuple[str, ...] = ()


def fix_file(config: str, options: Options, *, show_only: bool, colour: bool) -> FixReport:
    """Cure a config's files in its folder and below; with `show_only` print diffs instead.

    Raises:
        CommandFailedError: a file cannot be written; what could not be is as it was.
    """
    folder = (options.working_folder / config).resolve().parent
    fixed = fix_config(config, options, lambda path: path.is_relative_to(folder))
    lines = tuple(_lines(fixed, show_only=show_only))
    if show_only:
        for source, text in fixed.files:
            print_bytes(os.fsencode(report_diff(source, text, colour=colour)))
        return FixReport(outcome=fixed.before, lines=lines)
    opened = [(_opened(source), text) for source, text in fixed.files]
    for file, text in opened:
        write_edited(file, text)
    return FixReport(outcome=fixed.after, lines=lines)


def _opened(source: SourceFile) -> EditedFile:
    file = open_for_edit(source.path)
    if isinstance(file, Diagnostic) or file.source.text != source.text:
        raise CommandFailedError(f"`{source.path}` has changed meanwhile, nothing is written")
    return file


def _lines(fixed: Fixed, *, show_only: bool) -> list[str]:
    told = (
        ("would fix" if show_only else "fixed", fixed.done),
        ("not fixed, it would not be the same config any more:", fixed.refused),
        ("not fixed, the file is not in the config's folder:", fixed.outside),
    )
    return [f"{what} {_short(finding)}" for what, findings in told for finding in findings]


def _short(finding: Diagnostic) -> str:
    """The finding's first line, and what its first edit comes to."""
    first, *more = finding.fix
    now = f"now {first.text}" if first.text else "removed"
    others = f" ({len(more) + 1} times)" if more else ""
    return f"{finding}: {now}{others}"
