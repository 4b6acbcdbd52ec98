"""`obk graph CONFIG`: the block diagram, in the terminal or as an image."""

import shutil
import sys
from pathlib import Path
from typing import Annotated

import typer

from obelisk_spec.suggestions import list_names
from obk_cli.cli.compile import STDOUT, OutputOption, deliver
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
from obk_cli.emit.formats import FORMS
from obk_cli.emit.graph import graph_of
from obk_cli.emit.graphviz import emit_png
from obk_cli.emit.terminal import emit_terminal
from obk_cli.errors import MisuseError

__all__ = ["EXAMPLE", "command"]

EXAMPLE = """\b
Example: obk graph config.yaml --output diagram.svg
         obk graph config.yaml --output diagram.png
"""

_PICTURES = {**{name: FORMS[name].ending for name in ("mermaid", "dot", "svg")}, "png": ".png"}
"""Image format -> file extension."""
_TEXT = ".txt"
_WIDEST = 120
_NARROWEST = 80


def command(
    config: ConfigArgument,
    to: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(_PICTURES),
            help="Image format. Default: from the extension of the output file.",
        ),
    ] = None,
    output: OutputOption = None,
    ignore: IgnoreOption = None,
    set_: SetOption = None,
    color: ColourOption = "auto",
) -> None:
    """Draw a stack: its nodes, and the topics between them with type, rate and sensors.

    Without options, the graph is drawn in the terminal. Findings go to stderr.
    """
    if to is None:
        to = _picture_of(output)
    else:
        require_choice("--to", to, _PICTURES)
        _require_fit(to, output)
    if to == "png" and output in (None, STDOUT) and sys.stdout.isatty():
        raise MisuseError("`--to png` cannot be shown in a terminal; add `--output FILE`")
    outcome = compile_config(config, make_options(set_, ignore))
    plan = valid_plan(outcome, color, with_infos=True)
    if to is None:
        width = min(max(shutil.get_terminal_size((_NARROWEST, 24)).columns, _NARROWEST), _WIDEST)
        deliver(outcome.files, plan, emit_terminal(graph_of(plan), width), _TEXT, output)
    elif to == "png":
        deliver(outcome.files, plan, emit_png(graph_of(plan)), _PICTURES[to], output)
    else:
        deliver(outcome.files, plan, FORMS[to].emit(plan), _PICTURES[to], output)


def _require_fit(to: str, output: str | None) -> None:
    """Reject an output file with the extension of another image format."""
    path = Path(output or "")
    ending = path.suffix.lower()
    if ending != _PICTURES[to] and ending in _PICTURES.values() and not path.is_dir():
        raise MisuseError(
            f"`--to {to}`: `{output}` has the extension of another format",
            help=f"leave out `--to`, or use the extension `{_PICTURES[to]}`",
        )


def _picture_of(output: str | None) -> str | None:
    """The image format for a file name; None for text."""
    if output is None or output == STDOUT or Path(output).is_dir():
        return None
    ending = Path(output).suffix.lower()
    if ending in ("", _TEXT):
        return None
    for name, known in _PICTURES.items():
        if ending == known:
            return name
    raise MisuseError(
        f"`--output`: no image format has the extension `{ending}`",
        help=f"use one of {list_names((*_PICTURES.values(), _TEXT))}",
    )
