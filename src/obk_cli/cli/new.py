"""`obk new KIND NAME`: create a working package, add a node to an existing one, or create a
config.
"""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from obelisk_spec.suggestions import did_you_mean
from obk_cli.cli.new_run import NewOptions, add_to_options, find_library, run_new
from obk_cli.errors import MisuseError
from obk_cli.scaffold.kinds import RECIPES, Language, Recipe, Release
from obk_cli.scaffold.package_spec import (
    USUAL_CPP_SENSOR,
    USUAL_CTRL,
    USUAL_EST,
    USUAL_OF_SENSOR,
    USUAL_SENSOR,
    PackageRequest,
)
from obk_cli.scaffold.templates import TemplateLibrary

__all__ = ["app"]


class _Kinds(TyperGroup):
    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        command = super().get_command(ctx, cmd_name)
        if command is None and not ctx.resilient_parsing:
            raise MisuseError(
                f"unknown kind `{cmd_name}`", help=did_you_mean(cmd_name, self.commands)
            )
        return command


app = typer.Typer(
    cls=_Kinds,
    name="new",
    invoke_without_command=True,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)

Name = Annotated[
    str, typer.Argument(metavar="NAME", help="Name of the package and its node, lower snake case.")
]
_OR_THE_CONFIGS = "; with --add-to the config's"
CtrlMsg = Annotated[
    str | None,
    typer.Option(
        "--ctrl-msg", help="Control message type.", show_default=USUAL_CTRL + _OR_THE_CONFIGS
    ),
]
EstMsg = Annotated[
    str | None,
    typer.Option(
        "--est-msg", help="State estimate message type.", show_default=USUAL_EST + _OR_THE_CONFIGS
    ),
]
SensorMsg = Annotated[
    str | None,
    typer.Option(
        "--sensor-msg", help="Sensor message type.", show_default=USUAL_SENSOR + _OR_THE_CONFIGS
    ),
]
EstimatorSensorMsg = Annotated[
    str | None,
    typer.Option(
        "--sensor-msg",
        help="Sensor message type.",
        show_default=f"{USUAL_SENSOR}, in C++ {USUAL_CPP_SENSOR}{_OR_THE_CONFIGS}",
    ),
]
Lang = Annotated[Language, typer.Option("--lang", help="Language of the node.")]
Obelisk = Annotated[
    Release,
    typer.Option(
        "--obelisk", help="With --lang cpp: version of the C++ library, v0.1 to v0.4 or since 2026."
    ),
]
Dest = Annotated[
    Path | None,
    typer.Option(
        "--dest",
        metavar="DIR",
        help="Folder for the package.",
        show_default="src/ if it exists, otherwise .",
    ),
]
Templates = Annotated[
    Path | None,
    typer.Option(
        "--templates",
        metavar="DIR",
        help="Folder with your own templates; they take precedence over the built-in ones.",
        show_default="OBK_TEMPLATES, otherwise the user's config folder",
    ),
]
AddTo = Annotated[
    str | None,
    typer.Option("--add-to", metavar="CONFIG", help="Wire the node into this config."),
]
Device = Annotated[
    str | None,
    typer.Option("--device", metavar="NAME", help="With --add-to: the device that runs the node."),
]
Replace = Annotated[
    str | None,
    typer.Option(
        "--replace",
        metavar="NODE",
        help="With --add-to: the existing node to replace, by name or executable.",
    ),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Show what would be created, without writing it.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace existing files.")]
Format = Annotated[
    Literal["text", "json"], typer.Option("--format", metavar="text|json", help="Output format.")
]


@app.callback(epilog="\b\nExample: obk new controller my_controller\n         obk new --list")
def new(
    context: typer.Context,
    list_kinds: Annotated[
        bool, typer.Option("--list", help="List what can be created, with languages and templates.")
    ] = False,
    templates: Templates = None,
    format: Format = "text",
) -> None:
    """Create a ROS 2 package from templates, add a node to the current package, or create a
    config.
    """
    if list_kinds:
        print_kinds(templates, format)
        raise typer.Exit
    if context.invoked_subcommand is None:
        raise typer.Exit(2)


@app.command(
    "controller",
    epilog="\b\nExample: obk new controller my_controller\n"
    "         obk new controller my_controller --add-to config.yaml --dry-run",
)
def new_controller(
    name: Name,
    lang: Lang = "py",
    obelisk: Obelisk = "2026",
    ctrl_msg: CtrlMsg = None,
    est_msg: EstMsg = None,
    dest: Dest = None,
    add_to: AddTo = None,
    device: Device = None,
    replace: Replace = None,
    templates: Templates = None,
    dry_run: DryRun = False,
    force: Force = False,
    format: Format = "text",
) -> None:
    """Create a controller: state estimates in, control messages out."""
    request = PackageRequest(
        kind="controller",
        name=name,
        language=lang,
        release=obelisk,
        ctrl_msg=ctrl_msg,
        est_msg=est_msg,
    )
    run_new(
        request,
        NewOptions(
            dest=dest,
            templates=templates,
            dry_run=dry_run,
            force=force,
            form=format,
            add_to=add_to_options(add_to, device, replace),
        ),
    )


@app.command(
    "estimator",
    epilog="\b\nExample: obk new estimator my_estimator --sensor-msg ObkImu\n"
    "         obk new estimator my_estimator --add-to config.yaml --replace obelisk_estimation_0",
)
def new_estimator(
    name: Name,
    lang: Lang = "py",
    obelisk: Obelisk = "2026",
    est_msg: EstMsg = None,
    sensor_msg: EstimatorSensorMsg = None,
    dest: Dest = None,
    add_to: AddTo = None,
    device: Device = None,
    replace: Replace = None,
    templates: Templates = None,
    dry_run: DryRun = False,
    force: Force = False,
    format: Format = "text",
) -> None:
    """Create an estimator: sensor messages in, state estimates out."""
    request = PackageRequest(
        kind="estimator",
        name=name,
        language=lang,
        release=obelisk,
        est_msg=est_msg,
        sensor_msg=sensor_msg,
    )
    run_new(
        request,
        NewOptions(
            dest=dest,
            templates=templates,
            dry_run=dry_run,
            force=force,
            form=format,
            add_to=add_to_options(add_to, device, replace),
        ),
    )


@app.command("robot", epilog="Example: obk new robot my_robot --sensor-msg ObkJointEncoders")
def new_robot(
    name: Name,
    ctrl_msg: CtrlMsg = None,
    sensor_msg: SensorMsg = None,
    dest: Dest = None,
    add_to: AddTo = None,
    device: Device = None,
    replace: Replace = None,
    templates: Templates = None,
    dry_run: DryRun = False,
    force: Force = False,
    format: Format = "text",
) -> None:
    """Create a robot driver: control messages in, sensor messages out."""
    request = PackageRequest(kind="robot", name=name, ctrl_msg=ctrl_msg, sensor_msg=sensor_msg)
    run_new(
        request,
        NewOptions(
            dest=dest,
            templates=templates,
            dry_run=dry_run,
            force=force,
            form=format,
            add_to=add_to_options(add_to, device, replace),
        ),
    )


@app.command("sensor", epilog="Example: obk new sensor my_imu --sensor-msg ObkImu")
def new_sensor(
    name: Name,
    sensor_msg: Annotated[
        str | None,
        typer.Option("--sensor-msg", help="Sensor message type.", show_default=USUAL_OF_SENSOR),
    ] = None,
    dest: Dest = None,
    add_to: AddTo = None,
    device: Device = None,
    replace: Replace = None,
    templates: Templates = None,
    dry_run: DryRun = False,
    force: Force = False,
    format: Format = "text",
) -> None:
    """Create a driver for a separate sensor: sensor messages out."""
    request = PackageRequest(kind="sensor", name=name, sensor_msg=sensor_msg)
    run_new(
        request,
        NewOptions(
            dest=dest,
            templates=templates,
            dry_run=dry_run,
            force=force,
            form=format,
            add_to=add_to_options(add_to, device, replace),
        ),
    )


@app.command("msgs", epilog="Example: obk new msgs my_msgs --srv")
def new_msgs(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Name of the package, lower snake case.")
    ],
    srv: Annotated[bool, typer.Option("--srv", help="Also create a service type.")] = False,
    dest: Dest = None,
    templates: Templates = None,
    dry_run: DryRun = False,
    force: Force = False,
    format: Format = "text",
) -> None:
    """Create a package of message types for `obk build`."""
    request = PackageRequest(kind="msgs", name=name, with_service=srv)
    run_new(
        request,
        NewOptions(dest=dest, templates=templates, dry_run=dry_run, force=force, form=format),
    )


@app.command("config", epilog="Example: obk new config my_stack")
def new_config(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Name of the stack, lower snake case.")
    ],
    dest: Annotated[
        Path | None,
        typer.Option("--dest", metavar="DIR", help="Folder for the config.", show_default="."),
    ] = None,
    templates: Templates = None,
    dry_run: DryRun = False,
    force: Force = False,
    format: Format = "text",
) -> None:
    """Create a config from the workspace's nodes.

    Sections for which the workspace has no node get one from the dummy example.
    """
    request = PackageRequest(kind="config", name=name)
    run_new(
        request,
        NewOptions(dest=dest, templates=templates, dry_run=dry_run, force=force, form=format),
    )


def print_kinds(templates: Path | None, form: Literal["text", "json"]) -> None:
    """Print a line for each kind and language.

    Raises:
        CommandFailedError: the user's templates cannot be read.
    """
    library = find_library(templates)
    if form == "json":
        print(json.dumps([_as_json(recipe, library) for recipe in RECIPES], indent=2))
        return
    for recipe in RECIPES:
        print(f"{recipe.kind:<11} {recipe.language or '-':<4} {recipe.summary}")
        for layer, places in _places(recipe, library).items():
            print(f"{'':<17}{layer} ({', '.join(places)})")


def _places(recipe: Recipe, library: TemplateLibrary) -> dict[str, list[str]]:
    """Template folder -> where its files come from."""
    places: dict[str, list[str]] = {}
    for layer in recipe.layers:
        places[layer] = ["obk"]
        if library.user is not None and library.has_of_user([layer]):
            places[layer].append(str(library.user / layer))
    return places


def _as_json(recipe: Recipe, library: TemplateLibrary) -> dict[str, object]:
    return {
        "kind": recipe.kind,
        "language": recipe.language,
        "summary": recipe.summary,
        "templates": _places(recipe, library),
    }
