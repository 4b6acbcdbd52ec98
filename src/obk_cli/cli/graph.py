"""`obk graph CONFIG`: the block diagram, in the terminal or as a picture."""

import shutil
from pathlib import PurePath
from typing import Annotated

import typer

from obelisk_spec.near import list_names
from obk_cli.cli.compile import OutputOption, deliver, plan_or_exit
from obk_cli.cli.config_options import (
    ColourOption,
    ConfigArgument,
    IgnoreOption,
    SetOption,
    make_options,
    wants_colour,
)
from obk_cli.emit.forms import FORMS, Form
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
    plan = plan_or_exit(config, make_options(set_, ignore), wants_colour(color, to_stderr=True))
    deliver(plan, form, output)


def _form(to: str | None, output: str | None) -> Form:
    if to is None and output is not None:
        ending = PurePath(output).suffix
        to = next((name for name in _PICTURES if FORMS[name].ending == ending), None)
    if to is None:
        width = min(max(shutil.get_terminal_size((_NARROWEST, 24)).columns, _NARROWEST), _WIDEST)
        return Form(lambda plan: emit_terminal(graph_of(plan), width), ".txt")
    if to not in _PICTURES:
        raise MisuseError(f"`--to {to}`: expected one of {list_names(_PICTURES)}")
    return FORMS[to]
