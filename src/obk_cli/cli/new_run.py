"""The steps of every `obk new`: find the target, check the spec, write files, report them."""

import os
import shutil
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import typer

from obelisk_spec.names import OBELISK_MESSAGES, ROS_MESSAGES
from obelisk_spec.suggestions import ask_for, near_names
from obk_cli.cli.new_target import (
    TargetFolder,
    compose_config,
    find_joints,
    find_model,
    find_root,
    find_target,
    has_test_settings,
    read_package_texts,
    require_suitable_package,
)
from obk_cli.cli.options import print_note
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.files import STANDARD_INPUT, explain_os_error, resource_folder
from obk_cli.scaffold.compose import Composition, compose_addition, compose_package, layers_of
from obk_cli.scaffold.describe import (
    NewFiles,
    describe_json,
    describe_text,
    file_lines,
    unified_diff,
)
from obk_cli.scaffold.kinds import Problem
from obk_cli.scaffold.package_spec import PackageRequest, PackageSpec, check_request
from obk_cli.scaffold.templates import TemplateLibrary, open_library
from obk_cli.scaffold.variables import TestedStack
from obk_cli.scaffold.write import (
    Action,
    Decision,
    conflicts,
    decide,
    read_existing,
    write_decisions,
)
from obk_cli.workspace.package_index import PackageIndex, owner_of_module, owner_of_package

if TYPE_CHECKING:
    from obk_cli.cli.add_to import OpenConfig

__all__ = [
    "AddToOptions",
    "NewOptions",
    "add_to_options",
    "find_library",
    "programs",
    "resolve_conflicts",
    "run_new",
    "short",
    "write_files",
]

TESTS: Final = "test"
"""The folder of a package's tests."""
_CHOICES = "[k]eep it, [r]eplace it, show the [d]ifference, [q]uit"


def resolve_conflicts(decisions: tuple[Decision, ...]) -> tuple[Decision, ...]:
    """Ask about each conflicting file that could be replaced.

    Raises:
        CommandFailedError: the user quits.
    """
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return decisions
    return tuple(_resolve(d) if _can_be_replaced(d) else d for d in decisions)


def _can_be_replaced(decision: Decision) -> bool:
    return decision.action is Action.CONFLICT and decision.before is not None


def _resolve(decision: Decision) -> Decision:
    while True:
        match _ask(f"{decision.file.path} {decision.reason}: {_CHOICES}? "):
            case "k" | "keep":
                return replace(decision, action=Action.KEEP)
            case "r" | "replace":
                return replace(decision, action=Action.REPLACE)
            case "d" | "diff" | "difference":
                print(unified_diff([decision]), file=sys.stderr, end="")
            case "q" | "quit":
                raise CommandFailedError("nothing was created")
            case _:
                print("expected k, r, d or q", file=sys.stderr)


def _ask(question: str) -> str:
    print(question, file=sys.stderr, end="", flush=True)
    answer = sys.stdin.readline()
    return answer.strip().lower() if answer else "quit"


@dataclass(frozen=True, slots=True, kw_only=True)
class AddToOptions:
    """The `--add-to`, `--device` and `--replace` options."""

    config: str
    device: str | None = None
    replaces: str | None = None


def add_to_options(
    config: str | None, device: str | None, replaces: str | None
) -> AddToOptions | None:
    """The options as a value; None if no config is to be changed.

    Raises:
        MisuseError: an option lacks `--add-to`, or the config is standard input.
    """
    if config == STANDARD_INPUT:
        raise MisuseError("`--add-to -`: expected a file, because the config is edited in place")
    if config is not None:
        return AddToOptions(config=config, device=device, replaces=replaces)
    for option, value in (("--device", device), ("--replace", replaces)):
        if value is not None:
            raise MisuseError(f"`{option}` needs `--add-to CONFIG`")
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class NewOptions:
    """The options that all kinds share."""

    dest: Path | None = None
    templates: Path | None = None
    dry_run: bool = False
    force: bool = False
    form: Literal["text", "json"] = "text"
    add_to: AddToOptions | None = None
    """The config that the node is to be added to."""


def run_new(request: PackageRequest, options: NewOptions) -> None:
    """Create the files of a request and report them.

    Raises:
        MisuseError: a name or a message type is invalid.
        CommandFailedError: conflicting files exist; nothing was created.
    """
    config = Path(options.add_to.config) if options.add_to else None
    target = find_target(options.dest, request.kind, config)
    if target.package is not None:
        require_suitable_package(target, request)
    request = _with_model_controls(request, target)
    spec = _checked_spec(request, target)
    edited = _open_config(options.add_to) if options.add_to else None
    if edited:
        spec = _checked_spec(edited.with_types(request, spec), target)
    if spec.kind == "robot":
        joints = edited.robot_joints(spec.sensor) if edited else None
        joints = joints or find_joints(target.folder.resolve())
        spec = replace(spec, joints=joints) if joints else spec
    _note_missing_packages(spec, target)
    library = find_library(options.templates)
    root = target.folder.resolve() if request.kind == "config" else find_root(target, spec.node)
    edit = edited.add(spec) if edited else None
    stack = edit.tested_stack(spec.kind, root / TESTS) if edit else None
    composition = _compose(spec, library, root, target, stack)
    decisions = write_files(
        root,
        composition,
        dry_run=options.dry_run,
        force=options.force,
        form=options.form,
        finish=edit.write if edit else lambda: None,
    )
    result = NewFiles(
        spec=spec,
        folder=short(root),
        decisions=decisions,
        dry_run=options.dry_run,
        programs=programs(),
        added=edit.describe(is_done=not options.dry_run) if edit else None,
    )
    typer.echo(describe_json(result) if options.form == "json" else describe_text(result))


def _open_config(options: AddToOptions) -> "OpenConfig":
    from obk_cli.cli.add_to import open_config

    return open_config(options)


def write_files(
    root: Path,
    composition: Composition,
    *,
    dry_run: bool,
    force: bool,
    form: str = "text",
    remedy: str = "choose another name or --dest; --force replaces ordinary files",
    finish: Callable[[], None] = lambda: None,
) -> tuple[Decision, ...]:
    """Decide on each file, ask on a terminal, write, and `finish`.

    `remedy`: what the user can do about conflicting files.

    Raises:
        CommandFailedError: a conflicting file exists, or the folder cannot be written.
    """
    paths = [file.path for file in (*composition.files, *composition.edits)]
    try:
        existing = read_existing(root, paths)
    except OSError as fault:
        raise CommandFailedError(f"{short(root)} cannot be read: {fault}") from fault
    decisions = decide(composition.files, existing, edits=composition.edits, force=force)
    if dry_run:
        _show_conflicts(decisions)
    elif form == "text":
        decisions = resolve_conflicts(decisions)
    _refuse_conflicts(root, decisions, remedy)
    if not dry_run:
        _write(root, decisions, finish)
    return decisions


def find_library(chosen: Path | None) -> TemplateLibrary:
    """The built-in templates, overridden by the user's.

    The user's are in `chosen` (`--templates`), otherwise in OBK_TEMPLATES or in their config
    folder.

    Raises:
        CommandFailedError: the user's folder does not exist, or contains templates of an unknown
            kind.
    """
    try:
        return open_library(resource_folder("templates"), chosen or _usual_folder())
    except OSError as fault:
        raise CommandFailedError(f"the templates cannot be read: {fault}") from fault


def _usual_folder() -> Path | None:
    named = os.environ.get("OBK_TEMPLATES")
    if named:
        return Path(named)
    from platformdirs import user_config_path  # only if nothing else is set

    folder = user_config_path("obk") / "templates"
    return folder if folder.is_dir() else None


def require_valid(checked: PackageSpec | tuple[Problem, ...]) -> PackageSpec:
    """The spec that a check returned.

    Raises:
        MisuseError: the check returned problems; it lists all of them.
    """
    if isinstance(checked, PackageSpec):
        return checked
    *others, last = checked
    lines = [f"{problem.sentence} ({problem.help})" for problem in others]
    raise MisuseError("\n".join([*lines, last.sentence]), help=last.help)


def short(path: Path) -> str:
    """The path as the user would type it in the working folder."""
    cwd, full = Path.cwd(), path.resolve()
    return str(full.relative_to(cwd)) if full.is_relative_to(cwd) else str(full)


def programs() -> str:
    """Path prefix of `python` and `obk` on this machine; empty if they are on PATH."""
    folder = Path(sys.executable).parent
    found = shutil.which("python")
    return "" if found and Path(found).parent == folder else f"{short(folder)}/"


def _with_model_controls(request: PackageRequest, target: TargetFolder) -> PackageRequest:
    """For a controller, set the number of controls to that of the model's actuators."""
    model = find_model(target.folder.resolve()) if request.kind == "controller" else None
    return replace(request, controls=model.actuators) if model and model.actuators else request


def _checked_spec(request: PackageRequest, target: TargetFolder) -> PackageSpec:
    if request.kind == "config":
        return require_valid(check_request(request, owner_of=lambda _: None))
    index = PackageIndex.around(target.folder, Path.cwd(), os.environ)
    if target.package is not None:
        spec = check_request(request, owner_of=owner_of_module, messages=index)
        return require_valid(spec).in_package(target.package.name)
    owner_of = partial(owner_of_package, own_folder=target.folder / request.name, index=index)
    return require_valid(check_request(request, owner_of=owner_of, messages=index))


def _note_missing_packages(spec: PackageSpec, target: TargetFolder) -> None:
    """Print a note for each missing message package: it may be misspelled, or created later."""
    index = PackageIndex.around(target.folder, Path.cwd(), os.environ)
    used = {message.package for message in spec.messages} - {*OBELISK_MESSAGES, *ROS_MESSAGES}
    for package in sorted(name for name in used if index.message_names(name) is None):
        near = ask_for(near_names(package, index.message_packages()))
        fix = near or f"create it with `obk new msgs {package}`"
        print_note(f"the message package `{package}` does not exist yet: {fix}")


def _compose(
    spec: PackageSpec,
    library: TemplateLibrary,
    root: Path,
    target: TargetFolder,
    stack: TestedStack | None,
) -> Composition:
    templates = library.read(layers_of(spec, has_settings=has_test_settings(root)))
    if spec.kind == "config":
        return compose_config(spec, templates, root)
    if target.package is None:
        return compose_package(spec, templates, stack=stack)
    composition = compose_addition(
        spec,
        templates,
        read_package_texts(root),
        python_folder=target.python_folder,
        stack=stack,
    )
    if isinstance(composition, Problem):
        raise CommandFailedError(composition.sentence, help=composition.help)
    return composition


def _show_conflicts(decisions: tuple[Decision, ...]) -> None:
    """Show what a failing dry run would have created."""
    if conflicts(decisions):
        print("\n".join(file_lines(decisions)))
        print(f"\n{unified_diff(decisions)}", end="")


def _refuse_conflicts(root: Path, decisions: Iterable[Decision], remedy: str) -> None:
    blocked = conflicts(decisions)
    if blocked:
        lines = "\n".join(f"  {decision.file.path}: {decision.reason}" for decision in blocked)
        raise CommandFailedError(
            f"nothing was created; these files already exist in {short(root)}:\n{lines}",
            help=remedy,
        )


def _write(root: Path, decisions: Iterable[Decision], finish: Callable[[], None]) -> None:
    try:
        write_decisions(root, decisions, finish=finish)
    except OSError as fault:
        raise CommandFailedError(
            f"`{root}` cannot be written: {explain_os_error(fault)}; nothing was created"
        ) from fault
