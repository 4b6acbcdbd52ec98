"""`obk schema`: the JSON schema of configs, for editors and other checkers."""

from pathlib import Path
from typing import Annotated

import typer

from obk_cli.errors import MisuseError
from obk_cli.resources import resource_folder

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk schema > obelisk.schema.json"


def command(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="[DIR]", help="With --install-vscode: the folder to open."),
    ] = None,
    install_vscode: Annotated[
        bool,
        typer.Option(
            "--install-vscode",
            help="Write it for VS Code to DIR (default: here), print what to add.",
        ),
    ] = False,
) -> None:
    """Print the JSON schema (draft 2020-12) of configs, or write it for an editor."""
    path = resource_folder("schema") / "obelisk.schema.json"
    text = path.read_text(encoding="utf-8")
    if install_vscode:
        from obk_cli.cli.vscode import install_vscode as install

        for line in install(folder or Path(), text):
            print(line)
        return
    if folder is not None:
        raise MisuseError("a folder goes with `--install-vscode` only")
    print(text, end="")
