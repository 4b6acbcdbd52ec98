"""`obk migrate CONFIG`: convert a config between syntaxes; comments and layout are kept."""

import os
from typing import Annotated

import typer

from obk_cli.cli.config_options import ColourOption, ConfigArgument, print_findings, wants_colour
from obk_cli.configedit.edited_files import (
    EditedFile,
    open_for_edit,
    print_bytes,
    report_diff,
    write_edited,
)
from obk_cli.configedit.migrate import Migrated, migrate_source
from obk_cli.configedit.spelling import Spelling
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.errors import EXIT_DONE, EXIT_FAILED, MisuseError
from obk_cli.files import STANDARD_INPUT

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk migrate config.yaml --diff"

_SPELLINGS: dict[str, Spelling] = {"key": "key", "seed": "seed"}


def command(
    config: ConfigArgument,
    to: Annotated[
        str,
        typer.Option(
            metavar="key|seed",
            help="`key`: the newer syntax, with sections at the top level and components by "
            "`key`; `seed`: the older one, with device blocks and `ros_parameter`.",
        ),
    ] = "key",
    diff: Annotated[bool, typer.Option("--diff", help="Show what would change.")] = False,
    write: Annotated[bool, typer.Option("--write", help="Replace the file.")] = False,
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit 1 if anything would change.")
    ] = False,
    color: ColourOption = "auto",
) -> None:
    """Convert a config to the newer syntax, or back. Prints the result by default.

    Anything that cannot be migrated is left unchanged and reported on stderr with its location.
    Included files are not migrated. Exit code 0: done; 1: the file is not a readable config, or
    with --check would change; 2: usage error.
    """
    if to not in _SPELLINGS:
        raise MisuseError(f"`--to {to}`: expected `key` or `seed`")
    if write and (check or config == STANDARD_INPUT):
        other = "--check" if check else "a config from standard input"
        raise MisuseError(f"`--write` cannot be combined with {other}")
    file = open_for_edit(config)
    if isinstance(file, Diagnostic):
        print_findings((file,), color)
        raise typer.Exit(EXIT_FAILED)
    migrated = migrate_source(file.source, _SPELLINGS[to])
    print_findings((*migrated.faults, *migrated.kept), color)
    if migrated.faults:
        raise typer.Exit(EXIT_FAILED)
    _show(file, migrated, diff=diff, quiet=write or check, colour=wants_colour(color))
    if write:
        if migrated.is_changed:
            write_edited(file, migrated.text)
        print(f"{config}: {'migrated' if migrated.is_changed else 'nothing to change'}")
    if check:
        print(f"{config}: {'would change' if migrated.is_changed else 'nothing to change'}")
    raise typer.Exit(EXIT_FAILED if check and migrated.is_changed else EXIT_DONE)


def _show(file: EditedFile, migrated: Migrated, *, diff: bool, quiet: bool, colour: bool) -> None:
    if diff:
        text = report_diff(file.source, migrated.text, colour=colour)
        print_bytes(os.fsencode(text))
    elif not quiet:
        print_bytes(file.bytes_of(migrated.text))
