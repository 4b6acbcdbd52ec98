"""Shell scripts that only run a Python module."""

from pathlib import Path

import pytest

from obk_cli.workspace.entry_points import module_run_by

RUNS = 'exec "$prefix/bin/python" -P -m arm.run "$@"\n'


def module_of(tmp_path: Path, text: str) -> str | None:
    program = tmp_path / "run"
    program.write_text(text)
    return module_run_by(program)


def test_those_of_this_project_run_their_module(repository: Path) -> None:
    scripts = sorted((repository / "ros_packages").glob("*/scripts/*"))
    assert [module_run_by(script) for script in scripts] == [
        "obelisk_py.zoo.control.example",
        "obelisk_py.zoo.control.policy",
        "obelisk_py.zoo.estimation",
        "obelisk_py.core.sim.mujoco",
    ]


@pytest.mark.parametrize("before", ["", "# why\n\n", "prefix=$(pwd) || exit 127\n"])
def test_only_the_lookup_of_the_interpreter_may_precede_it(before: str, tmp_path: Path) -> None:
    assert module_of(tmp_path, f"#!/bin/sh\n{before}{RUNS}") == "arm.run"


@pytest.mark.parametrize(
    "text",
    [
        f"#!/bin/sh\nexport GAIN=1\n{RUNS}",
        f"#!/bin/sh\n. ./setup.sh\n{RUNS}",
        f"#!/bin/sh\nGAIN=1 {RUNS}",
        '#!/bin/sh\nexec python3 -m arm.run --fast "$@"\n',
        '#!/bin/sh\nexec "$prefix/bin/arm" "$@"\n',
        "#!/bin/sh\n",
        "#!/usr/bin/env python3\nprint()\n",
        "",
    ],
)
def test_any_other_program_runs_no_module(text: str, tmp_path: Path) -> None:
    assert module_of(tmp_path, text) is None


def test_a_missing_program_runs_none(tmp_path: Path) -> None:
    assert module_run_by(tmp_path / "none") is None
