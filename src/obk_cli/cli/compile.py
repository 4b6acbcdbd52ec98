"""`obk compile CONFIG`: a config as parameters, a launch file, a diagram or JSON."""

import os
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Final

import typer

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
from obk_cli.errors import MisuseError
from obk_cli.files import unwritable, write_bytes
from obk_cli.plan.plan import Plan

__all__ = ["EXAMPLE", "STDOUT", "OutputOption", "command", "deliver"]

EXAMPLE = "Example: obk compile config.yaml --to params --output build/dummy.params.yaml"

OutputOption = Annotated[
    str | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE|DIR",
        help="Output file, or a folder for a file named after the stack; `-` is stdout.",
    ),
]
STDOUT: Final = "-"


def command(
    config: ConfigArgument,
    to: Annotated[str, typer.Option(metavar="|".join(FORMS), help="Output format.")] = "plan",
    output: OutputOption = None,
    ignore: IgnoreOption = None,
    set_: SetOption = None,
    color: ColourOption = "auto",
) -> None:
    """Convert a valid config to formats that other programs read. Findings go to stderr.

    plan: all processes as JSON. params: a file for --params-file, for all nodes. launch: a file for
    `ros2 launch`. mermaid, dot, svg: the block diagram. json: nodes, topics, edges.
    """
    require_choice("--to", to, FORMS)
    outcome = compile_config(config, make_options(set_, ignore))
    plan = valid_plan(outcome, color, with_infos=True)
    deliver(outcome.files, plan, FORMS[to].emit(plan), FORMS[to].ending, output)


def deliver(
    files: Iterable[str], plan: Plan, content: str | bytes, ending: str, output: str | None
) -> None:
    """Print an export of the plan, or write it to a file; an identical file is not rewritten.

    Args:
        files: the config and the files that it includes; never replaced.
        plan: gives the default file name in a folder.
        content: the export.
        ending: file extension for the default name.
        output: a file, a folder, or `-` for stdout; None: stdout.

    Raises:
        CommandFailedError: the file cannot be written.
        MisuseError: the output is empty, one of these files, or one that a node reads.
    """
    if output == "":
        raise MisuseError("`--output`: expected a file or folder, but it is empty")
    if output is None or output == STDOUT:
        if isinstance(content, str):
            print(content, end="")
        else:
            sys.stdout.buffer.write(content)
        return
    data = content.encode("utf-8", "surrogateescape") if isinstance(content, str) else content
    path = Path(output)
    if path.is_dir() or output.endswith(os.sep):
        path /= re.sub(r"[^\w.-]", "_", plan.name) + ending
    try:
        if path.exists() and any(path.samefile(source) for source in _sources(files, plan)):
            raise MisuseError(
                f"`--output {path}` would replace a file that the config needs",
                help="choose another file",
            )
        write_bytes(path, data)
    except OSError as error:
        raise unwritable(path, error) from error


def _sources(files: Iterable[str], plan: Plan) -> Iterator[Path]:
    """The existing files from which a plan is made or which its nodes read."""
    named = [*files]
    for node in plan.nodes:
        named.append(node.model or "")
        named += (value for value in node.parameters.values() if isinstance(value, str))
    for name in dict.fromkeys(named):
        with suppress(OSError, ValueError):  # another string, perhaps too long for a path
            if Path(name).is_file():
                yield Path(name)
