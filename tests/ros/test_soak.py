"""A short soak with every fault once, which must leave nothing behind, and a few rounds."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from .stack import DUMMY

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def results(module: str, *options: str, root: Path, folder: Path) -> dict[str, Any]:
    """Run a program of the soak on the calm example and return its results.

    It ignores its verdict on growth, because a short run proves nothing about that.
    """
    command = (sys.executable, "-m", module, *options, "--config", DUMMY, "--results", folder)
    ended = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    found = list(folder.glob("*.json"))
    assert len(found) == 2, ended.stderr
    outcome, samples = (json.loads(path.read_text()) for path in sorted(found))
    return {**outcome, **samples}


def test_every_fault_is_handled_correctly_and_nothing_is_left(
    repository: Path, tmp_path: Path
) -> None:
    # Neither rates nor hangs, because tests that run at the same time use the CPU.
    asked = ("--seconds", "1", "--calm", "0.5", "--hang-after", "20", "--without-rates")
    result = results("benchmarks.soak", *asked, root=repository, folder=tmp_path)
    assert result["faults"] == []
    assert result["left"] == {"processes": [], "shm_files": []}
    assert {one["trouble"] for one in result["troubles"]} == {
        *("transitions", "kill", "observer", "observers_leave", "reload")
    }
    assert {"launcher", "shared memory"} < {one["who"] for one in result["samples"]}
    assert (tmp_path / "soak.svg").exists()


def test_one_process_repeats_its_lifecycle_and_is_measured(
    repository: Path, tmp_path: Path
) -> None:
    result = results("benchmarks.soak.rounds", "--rounds", "10", root=repository, folder=tmp_path)
    assert result["faults"] == []
    assert len({one["pid"] for one in result["samples"]}) == 2
    assert len(result["samples"]) > 10
    assert (tmp_path / "rounds.svg").exists()
