"""`obk test CONFIG [TESTS]...`: run pytest in a child process, in simulated time."""

import ast
import os
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Final

import typer

from obk_cli.cli.config_options import (
    ColourOption,
    IgnoreOption,
    SetOption,
    make_options,
    print_findings,
    valid_plan,
)
from obk_cli.compiler import compile_config
from obk_cli.errors import (
    EXIT_DONE,
    EXIT_FAILED,
    EXIT_INTERRUPTED,
    CommandFailedError,
    MisuseError,
)
from obk_cli.files import STANDARD_INPUT, path_exists, unwritable
from obk_cli.optional_deps import require_extra
from obk_cli.plan.plan import Plan

__all__ = ["EXAMPLE", "command", "default_tests", "is_smoke", "lockstep_environment"]

EXAMPLE = """\b
Example: obk test my_robot.yaml
         obk test my_robot.yaml tests/test_push.py --seeds 100 -j 8
         obk test my_robot.yaml --again 'tests/test_push.py::test_push[seed17]'
         obk test my_robot.yaml --twice -- --durations 5
"""
SMOKE: Final = "smoke"
"""Test ID of the smoke test, which runs if a config has no tests."""
_SMOKE_MODULE: Final = "obk_testing.smoke"
_NO_TESTS, _MISUSED = 5, 4
"""Exit codes of pytest."""
_SEED: Final = re.compile(r"\bseed(\d+)\b")
_SEEDS: Final = re.compile(r"=?\d+")
_TIME: Final = re.compile(r"(\d+(?:\.\d+)?)(s|m|h|)")
_UNITS_S: Final = MappingProxyType({"": 1, "s": 1, "m": 60, "h": 3600})


def command(
    config: Annotated[str, typer.Argument(metavar="CONFIG", help="Config file.")],
    tests: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[TESTS]...",
            help="Test files, folders or IDs, or `smoke` for the smoke test. Options after `--` "
            "are passed to pytest.",
        ),
    ] = None,
    seeds: Annotated[
        str,
        typer.Option(
            metavar="N|=K",
            help="Run each test that takes `seed` with N seeds; `--seeds =17` runs seed 17 only.",
        ),
    ] = "1",
    again: Annotated[
        str | None,
        typer.Option(metavar="TESTID", help="Repeat the test with this ID from the summary."),
    ] = None,
    twice: Annotated[
        bool,
        typer.Option("--twice", help="Run each test twice and fail if the runs differ."),
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option("-j", "--jobs", metavar="N", help="Number of tests to run in parallel."),
    ] = None,
    select: Annotated[
        str | None,
        typer.Option("-k", metavar="EXPRESSION", help="Run only tests that match this expression."),
    ] = None,
    stop_at_first: Annotated[bool, typer.Option("-x", help="Stop at the first failure.")] = False,
    time_limit: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="Start no more tests after this time, such as 90s, 10m or 1h."
        ),
    ] = None,
    junitxml: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a JUnit report.")
    ] = None,
    keep_all: Annotated[
        bool, typer.Option("--keep-all", help="Also keep recordings of tests that pass.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder for recordings and plots.",
            show_default="build/obk-test next to the config",
        ),
    ] = None,
    build: Annotated[
        bool,
        typer.Option("--build/--no-build", help="Compile out-of-date message packages."),
    ] = True,
    set_: SetOption = None,
    ignore: IgnoreOption = None,
    color: ColourOption = "auto",
) -> None:
    """Run closed-loop tests of a stack in simulated time: repeatable and faster than real time.

    All nodes run in one process, in lockstep with the simulated robot. TESTS are pytest files
    whose tests use the `stack` fixture; by default those in `tests/` next to the config. Without
    tests, a smoke test runs the stack for 5 s and checks that there are no faults, that values are
    finite, that topics meet their rates, and that two runs are identical.

    A failed test leaves a recording and a plot, and the summary shows the command that repeats the
    test. Hardware is never accessed. Exit code 0: all tests passed; 1: a test failed, or the config
    has errors; 2: no test was found, or the command line is invalid.
    """
    if config == STANDARD_INPUT:
        raise MisuseError("`obk test` needs the path of a config, not `-`")
    if _SEEDS.fullmatch(seeds) is None or seeds.lstrip("0") == "":
        raise MisuseError(f"`--seeds {seeds}`: expected a number of seeds, or `=SEED` for one")
    if jobs is not None and jobs < 1:
        raise MisuseError(f"`-j {jobs}`: expected a number of at least 1")
    names_modules = "--pyargs" in (tests or ())
    for word in takewhile(lambda word: not word.startswith("-"), tests or ()):
        if not names_modules and not _is_test(word):
            raise MisuseError(
                f"the test `{word}` does not exist",
                help="name a test file, a folder or an ID such as tests/test_push.py::test_push, "
                "or `smoke` for the smoke test",
            )
    if junitxml is not None:
        _require_writable(junitxml)
    limit_s = None if time_limit is None else _seconds_of(time_limit)
    # Only words after `--` can start with a hyphen.
    if again is not None and tests and not tests[0].startswith("-"):
        raise MisuseError("`--again` already names the test; leave out TESTS")
    require_extra("pytest", "test")
    if jobs is not None and jobs > 1:
        require_extra("xdist", "test")
    outcome = compile_config(config, replace(make_options(set_, ignore), for_test=True))
    plan = valid_plan(outcome, color)
    print_findings(outcome.hazards, color)
    folder = Path(config).resolve().parent
    if again is not None:
        tests = [_found_again(again, folder), *(tests or ())]
        seed = _SEED.search(again.partition("[")[2])
        seeds = f"={seed[1]}" if seed else seeds
    output = output or folder / "build" / "obk-test"
    options = [
        *("-p", "obk_testing.plugin", "-q", "--tb=short", "-rN"),
        *("--seeds", seeds, "--stack", config, "--trial-folder", str(output)),
        *(f"--stack-set={override}" for override in set_ or ()),
        *(("--twice",) if twice else ()),
        *(("-n", str(jobs)) if jobs is not None and jobs > 1 else ()),
        *(("-k", select) if select is not None else ()),
        *(("-x",) if stop_at_first else ()),
        *(("--time-limit", str(limit_s)) if limit_s is not None else ()),
        *(("--junitxml", str(junitxml)) if junitxml is not None else ()),
        *(("--keep-all",) if keep_all else ()),
        *(() if color == "auto" else ("--color", "yes" if color == "always" else "no")),
    ]
    environment = lockstep_environment(folder, plan, may_build=build, color=color)
    arguments = [*options, *_tests(tests or (), folder, output)]
    raise typer.Exit(_run_pytest(arguments, environment))


def _require_writable(path: Path) -> None:
    """Check before the tests run that their report can be written.

    Raises:
        CommandFailedError: it cannot.
    """
    is_new = not path.exists()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("a").close()
        if is_new:
            path.unlink()
    except OSError as error:
        raise unwritable(path, error) from error


def _seconds_of(time_limit: str) -> float:
    match = _TIME.fullmatch(time_limit)
    if match is None:
        raise MisuseError(f"`--time-limit {time_limit}`: expected a time such as 90s, 10m or 1h")
    return float(match[1]) * _UNITS_S[match[2]]


def lockstep_environment(
    folder: Path, plan: Plan, *, may_build: bool, color: str
) -> Mapping[str, str]:
    """The test process's environment: its nodes are isolated, and numerical results repeat."""
    from obk_cli.cli.build import on_overlays
    from obk_cli.launch.options import require_libraries
    from obk_cli.launch.process_groups import share_of
    from obk_cli.ros.environment import LAN_PROFILE, LOCALHOST_PROFILE, ros_environment

    require_libraries(plan, share_of(plan, None, None))
    environment = ros_environment("localhost")
    _, environment = on_overlays(folder, environment, plan, may_build=may_build, color=color)
    variables = {
        # Both disable shared memory, but the localhost profile would enable discovery.
        name: LAN_PROFILE if value == LOCALHOST_PROFILE else value
        for name, value in environment.variables.items()
    }
    threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    return {
        **variables,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF",
        "PYTHONHASHSEED": "0",
        **dict.fromkeys(threads, "1"),
    }


def _run_pytest(arguments: Sequence[str], environment: Mapping[str, str]) -> int:
    """Run pytest and return the exit code of `obk test`.

    Raises:
        MisuseError: no test was found.
        CommandFailedError: a test or node ended the process.
    """
    from obk_cli.process.child_process import run_in_foreground

    # Temporary files of tests are removed with this folder, even if workers are killed. Pytest's
    # own folders stay where users expect them.
    with tempfile.TemporaryDirectory(prefix="obk-test-") as scratch:
        variables = {
            "PYTEST_DEBUG_TEMPROOT": tempfile.gettempdir(),
            **environment,
            "TMPDIR": scratch,
            "ROS_LOG_DIR": str(Path(scratch, "log")),
        }
        end_file = Path(scratch, "end")
        options = ["--end-file", str(end_file)]
        words = [sys.executable, "-m", "pytest", *options, *arguments]
        code = run_in_foreground(words, variables, releases_interrupts=True)
        has_ended = end_file.exists()
    if code is None:
        return EXIT_INTERRUPTED
    if code in (0, _NO_TESTS) and not has_ended:
        raise CommandFailedError(
            f"the test process ended with exit code {code} before its tests did",
            help="look for `os._exit` in the nodes and tests, and in libraries that they call",
        )
    if code == _NO_TESTS:
        raise MisuseError(
            "no tests were run",
            help="a test is a function `test_...` that uses the `stack` fixture",
        )
    if code == _MISUSED:
        raise MisuseError("pytest rejected its arguments, see above")
    return EXIT_DONE if code == 0 else EXIT_FAILED


def _tests(given: Sequence[str], folder: Path, output: Path) -> Iterator[str]:
    """The arguments for pytest: the tests named by the user, otherwise those beside the config."""
    named = [word for word in given if _is_test(word)]
    if not named:
        beside = default_tests(folder)
        named = [SMOKE if beside is None else str(beside)]
        given = [*given, *named]
    if all(map(is_smoke, named)):
        # The installed module ignores the user's settings and leaves no files beside itself.
        yield from ("-c", os.devnull, "--rootdir", str(folder), "-p", "no:cacheprovider")
    else:
        yield from ("-o", f"cache_dir={output / '.pytest_cache'}")
    for word in given:
        yield from _smoke_arguments(word) if is_smoke(word) else (word,)


def _is_test(word: str) -> bool:
    return is_smoke(word) or path_exists(word.partition("::")[0])


def is_smoke(word: str) -> bool:
    """Whether a test's name means the smoke test, which no file hides."""
    return word.partition("[")[0] == SMOKE and not path_exists(word)


def _smoke_arguments(word: str) -> Iterator[str]:
    yield "--pyargs"
    yield f"{_SMOKE_MODULE}::test_{word}" if "[" in word else _SMOKE_MODULE


def _found_again(node_id: str, folder: Path) -> str:
    """Resolve a test ID relative to the working folder or to the config's folder.

    Raises:
        MisuseError: the test file does not exist.
    """
    path, colons, rest = node_id.partition("::")
    if _is_test(node_id):
        return node_id
    if path_exists(folder / path):
        return f"{folder / path}{colons}{rest}"
    raise MisuseError(
        f"`--again {node_id}`: file `{path}` not found",
        help="copy the ID from the summary of `obk test`, such as "
        "'tests/test_push.py::test_push[seed17]'",
    )


def default_tests(folder: Path) -> Path | None:
    """The `tests` folder next to a config, if a test in it uses the `stack` fixture."""
    tests = folder / "tests"
    patterns = ("test_*.py", "*_test.py", "conftest.py")
    files = [file for pattern in patterns for file in sorted(tests.rglob(pattern))]
    return tests if any(_uses_stack(file) for file in files) else None


def _uses_stack(path: Path) -> bool:
    """Whether a function takes `stack`, and the file defines no fixture of that name.

    Pytest reports a file that cannot be read.
    """
    with suppress(OSError, SyntaxError, ValueError):
        functions = [
            node
            for node in ast.walk(ast.parse(path.read_bytes()))
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        ]
        arguments = {
            argument.arg
            for function in functions
            for argument in (*function.args.args, *function.args.kwonlyargs)
        }
        return "stack" in arguments - {function.name for function in functions}
    return True
