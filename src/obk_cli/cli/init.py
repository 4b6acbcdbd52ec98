"""`obk init [DIR]`: a workspace whose stack can be launched at once."""

import json
import os
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from obk_cli.cli.new_run import find_library, programs, short, write_files
from obk_cli.cli.schema import SCHEMA_PATH
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.files import resource_folder
from obk_cli.install_source import read_install_source
from obk_cli.optional_deps import require_extra
from obk_cli.scaffold.compose import Composition, check_stack, compose_workspace
from obk_cli.scaffold.describe import file_lines, opening_line, unified_diff
from obk_cli.scaffold.kinds import Problem, check_name
from obk_cli.scaffold.package_spec import PackageSpec
from obk_cli.scaffold.robot_model import describe_robot
from obk_cli.scaffold.templates import RenderedFile
from obk_cli.scaffold.write import Decision
from obk_cli.workspace.package_index import PackageIndex, owner_of_package

if TYPE_CHECKING:
    from obk_cli.workspace.model_files import ModelCopy

__all__ = ["EXAMPLE", "command"]

EXAMPLE = """\b
Example: obk init my_robot
         cd my_robot && obk launch my_robot.yaml
         obk init my_robot --model path/to/robot.xml
"""


def command(
    folder: Annotated[
        Path,
        typer.Argument(metavar="[DIR]", help="Workspace folder; the stack is named after it."),
    ] = Path(),
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            metavar="FILE",
            help="Copy this robot model (MJCF or URDF) and create a stack that holds the robot in "
            "place.",
            show_default="an arm with three joints",
        ),
    ] = None,
    templates: Annotated[
        Path | None,
        typer.Option(
            "--templates",
            metavar="DIR",
            help="Folder with your own templates; they take precedence over the built-in ones.",
            show_default="OBK_TEMPLATES, otherwise the user's config folder",
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show what would be created, without writing it.")
    ] = False,
    format: Annotated[
        Literal["text", "json"],
        typer.Option("--format", metavar="text|json", help="Output format."),
    ] = "text",
) -> None:
    """Create a workspace: a config, a robot model, a controller, an estimator, tests and checks.

    Existing files are not overwritten without asking. If one differs and there is no terminal, the
    command fails.
    """
    root = folder.resolve()
    stack = folder.name if folder.is_symlink() else root.name
    if folder.is_symlink() and not root.exists():
        raise CommandFailedError(f"{folder} is a symbolic link to {root}, which does not exist")
    packages = _check(stack, root)
    library = find_library(templates)
    source = read_install_source().for_other_machines()
    copy = _copy_model(model, stack) if model else None
    if copy and copy.robot.hold.is_torque:
        packages = _check(stack, root, is_torque=True)
    robot = copy.robot if copy else None
    files = compose_workspace(stack, packages, library, source, robot)
    composition = _with_schema((*files, *(copy.files if copy else ())), root)
    decisions = write_files(
        root,
        composition,
        dry_run=dry_run,
        force=False,
        form=format,
        remedy="choose another folder, or move these files; on a terminal, `obk` asks about each "
        "of them",
    )
    describe = _describe_json if format == "json" else _describe_text
    notes = describe_robot(robot) if robot else ()
    typer.echo(describe(stack, root, decisions, notes, dry_run=dry_run))


def _copy_model(path: Path, stack: str) -> "ModelCopy":
    require_extra("mujoco", "sim")
    from obk_cli.workspace.model_files import copy_model  # imports MuJoCo and numpy

    return copy_model(path, stack)


def _check(stack: str, root: Path, *, is_torque: bool = False) -> tuple[PackageSpec, ...]:
    if root.exists() and not root.is_dir():
        raise CommandFailedError(f"{short(root)} is a file, expected a folder or a new name")
    if (root / "package.xml").is_file():
        raise CommandFailedError(
            f"{short(root)} is a package; a workspace is the folder around packages",
            help="choose another folder",
        )
    around = PackageIndex.around(root, root, os.environ)
    index = replace(around, workspaces=(root,))  # packages of other workspaces are not visible here

    def owner_of(name: str) -> str | None:
        return owner_of_package(name, own_folder=root / "src" / name, index=index)

    fault = check_name(stack, kind="stack", owner_of=lambda _: None)
    packages = fault or check_stack(stack, owner_of=owner_of, is_torque=is_torque)
    if isinstance(packages, Problem):
        raise MisuseError(
            f"the folder's name would become the stack's name, but {packages.sentence}",
            help=packages.help,
        )
    return packages


def _with_schema(files: Iterable[RenderedFile], root: Path) -> Composition:
    """Add the JSON schema that the config refers to; replace one of another obk version."""
    text = (resource_folder("schema") / "obelisk.schema.json").read_bytes()
    schema = RenderedFile(path=SCHEMA_PATH, content=text)
    if (root / SCHEMA_PATH).is_file():
        return Composition(files=tuple(files), edits=(schema,))
    return Composition(files=(*files, schema))


def _next_commands(stack: str, root: Path) -> tuple[str, ...]:
    """Commands to run next, with paths relative to the working folder."""
    is_here = root == Path.cwd()
    prefix = f"{Path(sys.executable).parent}/" if programs() else ""
    return (
        *(() if is_here else (f"cd {short(root)}",)),
        f"{prefix}obk validate {stack}.yaml",
        f"{prefix}obk launch {stack}.yaml",
        f"{prefix}obk test {stack}.yaml",
    )


def _describe_text(
    stack: str,
    root: Path,
    decisions: tuple[Decision, ...],
    notes: tuple[str, ...],
    *,
    dry_run: bool,
) -> str:
    what = f"the workspace `{stack}` in {short(root)}/"
    lines = [
        opening_line(what, decisions, dry_run=dry_run),
        *file_lines(decisions),
        *(("", *notes) if notes else ()),
        "",
        "next:",
        *(f"  {line}" for line in _next_commands(stack, root)),
    ]
    return "\n".join([*lines, *(("", unified_diff(decisions)) if dry_run else ())])


def _describe_json(
    stack: str,
    root: Path,
    decisions: tuple[Decision, ...],
    notes: tuple[str, ...],
    *,
    dry_run: bool,
) -> str:
    result = {
        "stack": stack,
        "folder": short(root),
        "dry_run": dry_run,
        "files": [{"path": str(d.file.path), "action": d.action.value} for d in decisions],
        "notes": list(notes),
        "next": list(_next_commands(stack, root)),
    }
    return json.dumps(result | ({"diff": unified_diff(decisions)} if dry_run else {}), indent=2)
