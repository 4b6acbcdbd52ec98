"""`obk launch CONFIG`: validate, start, configure, activate, supervise and shut down a stack.

The modules that do this are imported once the preload server has started, so that it imports the
libraries in the meantime.
"""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, cast, get_args

import typer

from obelisk_spec.values import OnCrash
from obk_cli.cli.config_options import (
    ColourOption,
    ConfigArgument,
    IgnoreOption,
    SetOption,
    make_options,
    valid_plan,
    wants_colour,
)
from obk_cli.cli.options import require_choice, require_positive
from obk_cli.errors import MisuseError
from obk_cli.launch.transitions import UNTIL, Until
from obk_cli.launch.warden_client import early_warden
from obk_cli.ros.environment import Network, ros_environment

__all__ = ["EXAMPLE", "OPTION_GROUPS", "command"]

EXAMPLE = """\b
Example: obk launch examples/dummy/dummy.yaml --duration 20
         obk launch config.yaml --set 'robot[0].sim[0].time_step=0.001'
         obk launch config.yaml --record --duration 60
         obk launch config.yaml --viewer web
         obk launch config.yaml --render out.mp4 --render-camera side --duration 10
"""
OPTION_GROUPS = MappingProxyType(
    {
        "What runs": ("--until", "--duration", "--sim-duration", "--composed", "--set", "--build"),
        "Supervision": ("--on-crash", "--hang-after", "--timeout", "--strict-rates", "--replace"),
        "Simulation": ("--viewer", "--render", "--render-camera", "--render-size", "--render-fps"),
        "Recording": ("--record", "--record-topic", "--keep"),
        "Network": ("--network", "--allow-foreign", "--device", "--lead"),
        "Output": ("--quiet", "--log-level", "--ignore", "--format", "--color", "--help"),
    }
)
"""The options as `obk launch --help` groups them."""
FORMATS = ("text", "json")
VIEWERS = ("none", "native", "web")


def command(
    config: ConfigArgument,
    until: Annotated[
        str,
        typer.Option(metavar="|".join(UNTIL), help="Bring the stack up to this lifecycle state."),
    ] = "active",
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Stop the stack after this time [s].")
    ] = None,
    sim_duration: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS", help="Stop after this simulated time [s]; needs a simulated robot."
        ),
    ] = None,
    timeout: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            help="Time limit for a transition [s]. Startup gets at least 20 s, and each transition "
            "at shutdown 3 s, or this time if it is above 10 s.",
        ),
    ] = 10.0,
    on_crash: Annotated[
        str,
        typer.Option(
            metavar="|".join(get_args(OnCrash)),
            help="What to do when a node without its own `on_crash` crashes or hangs.",
        ),
    ] = "stop",
    hang_after: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            help="Treat a node as hung if it does not answer for this long [s]; 0: never.",
        ),
    ] = 1.3,
    strict_rates: Annotated[
        bool,
        typer.Option(
            "--strict-rates", help="Stop with exit code 1 if a node misses its rate for 2 s."
        ),
    ] = False,
    composed: Annotated[
        bool, typer.Option("--composed", help="Run the Python nodes in one process.")
    ] = False,
    device: Annotated[
        str | None, typer.Option(metavar="NAME", help="Run the nodes of this device only.")
    ] = None,
    lead: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="With --device: the device that leads. Default: the one with `control`.",
        ),
    ] = None,
    replace_: Annotated[
        bool,
        typer.Option(
            "--replace",
            help="First shut down any running stack that has the same name or shares a node name.",
        ),
    ] = False,
    allow_foreign: Annotated[
        bool,
        typer.Option("--allow-foreign", help="Allow other nodes to publish robot commands."),
    ] = False,
    record: Annotated[
        bool, typer.Option("--record", help="Record the config's topics as MCAP.")
    ] = False,
    record_topic: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TOPIC", help="Record these topics (names, patterns) instead; may be repeated."
        ),
    ] = None,
    viewer: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(VIEWERS),
            help="Show the simulated robot in a window or in the browser.",
        ),
    ] = None,
    render: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help=(
                "Record a video of the simulated robot (.mp4, .gif), or a still image of its "
                "final state (.png)."
            ),
        ),
    ] = None,
    render_camera: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Camera of the model. Default: a view of the whole model."
        ),
    ] = None,
    render_size: Annotated[
        str | None,
        typer.Option(
            metavar="WxH", help="Size in pixels. Default: that of the camera, or 640x480."
        ),
    ] = None,
    render_fps: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="Frames per simulated second. Default: 30, or 15 for a GIF."
        ),
    ] = None,
    network: Annotated[
        str | None,
        typer.Option(
            metavar="localhost|lan",
            help="Hosts that can discover the stack: only this one, or all on the local network. "
            "Default: localhost, or lan if some nodes run on other hosts.",
        ),
    ] = None,
    log_level: Annotated[
        str | None, typer.Option(metavar="LEVEL", help="Log level for nodes that do not set one.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Hide the nodes' output.")] = False,
    format: Annotated[str, typer.Option(metavar="|".join(FORMATS), help="Output format.")] = "text",
    keep: Annotated[int, typer.Option(help="Number of unrecorded runs to keep.")] = 50,
    build: Annotated[
        bool,
        typer.Option("--build/--no-build", help="Compile out-of-date message packages."),
    ] = True,
    set_: SetOption = None,
    ignore: IgnoreOption = None,
    color: ColourOption = "auto",
) -> None:
    """Start a stack, bring it up, supervise it, and shut it down cleanly.

    Out-of-date message packages in the workspace are compiled first.
    The command ends on Ctrl-C, on SIGTERM, after --duration or --sim-duration, or when a node
    fails. When it ends, so do all processes of the stack. Exit code 0: shut down cleanly; 1: the
    config has errors, a node failed, a node missed its rate (with --strict-rates), or the robot was
    still rejecting every command when the stack stopped.
    """
    require_choice("--until", until, tuple(UNTIL))
    require_choice("--on-crash", on_crash, get_args(OnCrash))
    require_choice("--format", format, FORMATS)
    if viewer is not None:
        require_choice("--viewer", viewer, VIEWERS)
    _check_numbers(timeout, hang_after, keep, duration)
    require_positive("--sim-duration", sim_duration, "a number of seconds")
    if sim_duration is not None and until != "active":
        raise MisuseError(f"`--sim-duration`: the simulation does not run with `--until {until}`")
    if network is not None:
        require_choice("--network", network, get_args(Network))
    with early_warden(cast(Network | None, network), is_composed=composed) as warden:
        from obk_cli.cli.build import on_overlays
        from obk_cli.cli.launch_plan import (
            gated_executables,
            limits_for,
            recording_of,
            require_devices,
            with_log_level,
            with_viewer,
        )
        from obk_cli.compiler import compile_config
        from obk_cli.launch.console import open_console
        from obk_cli.launch.options import (
            LaunchOptions,
            RenderArguments,
            require_libraries,
            require_simulated_time,
            with_render,
        )
        from obk_cli.launch.process_groups import share_of
        from obk_cli.launch.run import run_plan
        from obk_cli.optional_deps import require_ros

        require_ros()
        outcome = compile_config(config, make_options(set_, ignore))
        plan = with_log_level(valid_plan(outcome, color), log_level)
        require_devices(plan, device, lead)
        share = share_of(plan, device, lead)
        if sim_duration is not None:
            require_simulated_time(plan, share)
        require_libraries(plan, share)
        render_arguments = RenderArguments(
            path=render, camera=render_camera, size=render_size, rate_hz=render_fps
        )
        plan = with_render(with_viewer(plan, share, viewer), share, render_arguments)
        environment = ros_environment(
            cast(Network | None, network), devices_are_split=share.is_part
        )
        _warn(environment.notes)
        folder = Path(config).resolve().parent
        packages, environment = on_overlays(folder, environment, plan, may_build=build, color=color)
        options = LaunchOptions(
            config=config,
            folder=Path.cwd(),
            share=share,
            until=cast(Until, until),
            duration_s=duration,
            sim_duration_s=sim_duration,
            limits=limits_for(timeout, hang_after),
            on_crash=cast(OnCrash, on_crash),
            strict_rates=strict_rates,
            is_composed=composed,
            replaces=replace_,
            allows_foreign=allow_foreign,
            recording=recording_of(record_topic or (), plan) if record or record_topic else None,
            kept_runs=keep,
            gated_executables=gated_executables(plan, outcome.environment),
        )
        with open_console(
            sys.stdout.fileno(),
            as_json=format == "json",
            colour=wants_colour(color),
            quiet=quiet,
            terminal=os.environ.get("TERM", ""),
        ) as console:
            ended = run_plan(plan, packages, environment, options, console, warden)
    raise typer.Exit(ended.exit_code)


def _check_numbers(timeout: float, hang_after: float, keep: int, duration: float | None) -> None:
    for option, number, is_fit, expected in (
        ("--timeout", timeout, timeout > 0, "a number of seconds above 0"),
        ("--hang-after", hang_after, hang_after >= 0, "seconds of at least 0"),
        ("--keep", keep, keep >= 1, "a number of at least 1"),
        ("--duration", duration, duration is None or duration >= 0, "seconds of at least 0"),
    ):
        if not is_fit:
            raise MisuseError(f"`{option} {number:g}`: expected {expected}")


def _warn(notes: Sequence[str]) -> None:
    for note in notes:
        print(f"warning: {note}", file=sys.stderr)
