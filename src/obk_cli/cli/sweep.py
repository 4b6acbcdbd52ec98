"""`obk sweep CONFIG [TEST]`: run closed-loop tests across many seeds and parameter values."""

import json
import math
import os
import sys
from pathlib import Path
from typing import Annotated, Final

import typer

from obk_cli.cli.config_options import (
    ColourOption,
    IgnoreOption,
    SetOption,
    make_options,
    valid_plan,
)
from obk_cli.cli.options import FormatOption, require_choice, wants_json
from obk_cli.cli.test import default_tests, is_smoke, lockstep_environment
from obk_cli.compiler import compile_config
from obk_cli.errors import MisuseError
from obk_cli.files import path_exists
from obk_cli.optional_deps import require_extra
from obk_cli.process.signals import hold_interrupts

__all__ = ["EXAMPLE", "command"]

EXAMPLE = """\b
Example: obk sweep examples/arm/arm.yaml --seeds 1000
         obk sweep examples/arm/arm.yaml --vary control.params.move_s=2..3 --seeds 50
         obk sweep config.yaml --vary control.params.gain=1..9:5 --grid
"""
ENGINES: Final = ("local", "dask")


def command(
    config: Annotated[str, typer.Argument(metavar="CONFIG", help="Config file.")],
    test: Annotated[
        str | None,
        typer.Argument(
            metavar="[TEST]",
            help="Test, such as `tests/test_arm.py::test_push`, a test file, or `smoke`. Default: "
            "the tests in `tests/` next to the config, otherwise the smoke test.",
        ),
    ] = None,
    seeds: Annotated[
        int,
        typer.Option(
            min=1, help="Number of seeds. With `--vary`: number of samples, each with its own seed."
        ),
    ] = 1,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATH=RANGE",
            help="Vary a config value over a range (`50..200`) or a list (`1,2,5`); may be "
            "repeated.",
        ),
    ] = None,
    grid: Annotated[
        bool,
        typer.Option(
            "--grid",
            help="Run every combination of values with every seed. Each range must give its "
            "number of values: `50..200:7` has 7. Default: Latin hypercube samples.",
        ),
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            "-j", "--jobs", min=1, help="Number of worker processes. Default: one per core."
        ),
    ] = None,
    engine: Annotated[
        str,
        typer.Option(
            metavar="|".join(ENGINES), help="Where cases run; `dask` needs the `sweep` extra."
        ),
    ] = "local",
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Dask scheduler, such as tcp://host:8786. Default: a cluster on this machine.",
        ),
    ] = None,
    output: Annotated[
        str | None,
        typer.Option(
            metavar="FOLDER",
            help="Output folder. Default: build/obk-sweep/NAME in the current folder.",
        ),
    ] = None,
    restart: Annotated[
        bool, typer.Option("--restart", help="Remove existing results and run all cases.")
    ] = False,
    case_limit: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            min=0.1,
            help="Wall-clock time limit for a case [s]; a case that exceeds it is terminated and "
            "counts as failed.",
        ),
    ] = 600.0,
    format: FormatOption = "text",
    set_: SetOption = None,
    ignore: IgnoreOption = None,
    color: ColourOption = "auto",
) -> None:
    """Run closed-loop tests across many seeds and parameter values.

    Results are kept in a database; run the same command again to resume an interrupted sweep.
    `report.html` shows pass rates, distributions and the worst cases with the commands that run
    them again. Exit code 0: all cases passed; 1: at least one did not, or the config has errors.
    """
    is_json = wants_json(format)
    require_choice("--engine", engine, ENGINES)
    if config == "-":
        raise MisuseError("`obk sweep` loads the config more than once, so it needs a file")
    if scheduler is not None and engine != "dask":
        raise MisuseError("`--scheduler` is for `--engine dask`")
    if not math.isfinite(case_limit):
        raise MisuseError(f"`--case-limit {case_limit}`: expected a number of seconds")
    require_extra("pytest", "test")
    if engine == "dask":
        require_extra("distributed", "sweep")
    path = Path(config).resolve()
    tests = _tests(test, path.parent)
    plan = valid_plan(compile_config(config, make_options(set_, ignore)), color)
    environment = lockstep_environment(path.parent, plan, may_build=True, color=color)
    request = {
        "config": config,
        "tests": tests,
        "seeds": seeds,
        "vary": vary or [],
        "is_grid": grid,
        "workers": jobs or os.cpu_count() or 1,
        "engine": engine,
        "scheduler": scheduler,
        "output": output,
        "is_restart": restart,
        "case_limit_s": case_limit,
        "overrides": set_ or [],
        "is_json": is_json,
    }
    sys.stdout.flush()
    sys.stderr.flush()
    # Replaces this process, which must not import the test library.
    hold_interrupts()
    command = [sys.executable, "-P", "-m", "obk_testing.sweep", json.dumps(request)]
    os.execve(sys.executable, command, dict(environment))  # noqa: S606 - without a shell


def _tests(test: str | None, folder: Path) -> list[str]:
    """What pytest collects from, as absolute paths; nothing for the smoke test.

    Raises:
        MisuseError: the file does not exist.
    """
    if test is not None and is_smoke(test):
        return []
    if test is None:
        beside = default_tests(folder)
        return [] if beside is None else [str(beside)]
    path, colons, name = test.partition("::")
    for start in (Path.cwd(), folder):
        if path_exists(start / path):
            return [f"{(start / path).resolve()}{colons}{name}"]
    raise MisuseError(
        f"the test `{path}` does not exist",
        help="give its path relative to this folder or to that of the config, such as "
        "`tests/test_robot.py::test_it_stands`",
    )
