"""`obk graph CONFIG`: the block diagram, in the terminal or as a picture."""

import shutil
from pathlib import Path
from typing import Annotated

import typer

from obk_cli.cli.compile import OutputOption, deliver
from obk_cli.cli.config_options import (
    ColourOption,
    ConfigArgument,
    IgnoreOption,
    SetOption,
    make_options,
    valid_plan,
)
from obk_cli.cli.options import require_choice
from obk_cli.compiler import compile_config
from obk_cli.emit.formats import FORMS, Form
from obk_cli.emit.graph import graph_of
from obk_cli.emit.terminal import emit_terminal
from obk_cli.errors import MisuseError

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk graph config.yaml --output diagram.svg"

_PICTURES = ("mermaid", "dot", "svg")
_WIDEST = 120
_NARROWEST = 80


def command(
    config: ConfigArgument,
    to: Annotated[
        str | None,
        typer.Option(metavar="|".join(_PICTURES), help="A picture; else by the output's name."),
    ] = None,
    output: OutputOption = None,
    ignore: IgnoreOption = None,
    set_: SetOption = None,
    color: ColourOption = "auto",
) -> None:
    """Draw a stack: its nodes, and the topics between them with type, rate and sensors.

    Without options the drawing is for the terminal. Findings go to stderr.
    """
    form = _form(to, output)
    outcome = compile_config(config, make_options(set_, ignore))
    deliver(valid_plan(outcome, color, with_infos=True), form, output)


def _form(to: str | None, output: str | None) -> Form:
    if to is None and output is not None:
        to = _picture_of(Path(output))
    if to is None:
        width = min(max(shutil.get_terminal_size((_NARROWEST, 24)).columns, _NARROWEST), _WIDEST)
        return Form(lambda plan: emit_terminal(graph_of(plan), width), ".txt")
    require_choice("--to", to, _PICTURES)
    return FORMS[to]


def _picture_of(output: Path) -> str | None:
    """The picture that a file with this name holds; None for text."""
    pictures = {FORMS[name].ending: name for name in _PICTURES}
    ending = output.suffix
    if ending in ("", ".txt") or output.is_dir():
        return None
    if ending not in pictures:
        known = ", ".join((*pictures, ".txt"))
        raise MisuseError(
            f"`--output`: no picture has the ending `{ending}`", help=f"use one of {known}"
        )
    return pictures[ending]
