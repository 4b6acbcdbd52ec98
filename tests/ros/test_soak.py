"""A short soak: every trouble once, answered as the rules say, and nothing left; a few rounds."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from .stack import DUMMY

pytestmark = pytest.mark.ros


def test_every_trouble_is_answered_as_the_rules_say_and_nothing_is_left(
    repository: Path, tmp_path: Path
) -> None:
    # Neither rates nor hangs: whoever tests beside this one takes the processor.
    asked = ("--seconds", "1", "--calm", "0.5", "--hang-after", "20", "--without-rates")
    ended = subprocess.run(
        [
            *(sys.executable, "-m", "benchmarks.soak", *asked),
            *("--config", str(DUMMY), "--results", str(tmp_path)),
        ],
        cwd=repository,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (tmp_path / "soak.json").exists(), ended.stderr
    # Not whether it grew: that a minute says nothing of, and a busy machine needs more than one.
    result = json.loads((tmp_path / "soak.json").read_text())
    assert result["faults"] == []
    assert result["left"] == {"processes": [], "shm_files": []}
    assert {one["trouble"] for one in result["troubles"]} == {
        *("transitions", "kill", "onlooker", "onlookers_leave", "reload")
    }
    assert {"launcher", "shared memory"} < {one["who"] for one in result["samples"]}
    assert (tmp_path / "soak.svg").exists()


def test_one_process_goes_round_its_life_cycle_and_is_counted(
    repository: Path, tmp_path: Path
) -> None:
    # Not whether it grew: that a few rounds say nothing of.
    ended = subprocess.run(
        [
            *(sys.executable, "-m", "benchmarks.soak.rounds", "--rounds", "10"),
            *("--config", str(DUMMY), "--results", str(tmp_path)),
        ],
        cwd=repository,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (tmp_path / "rounds.json").exists(), ended.stderr
    result = json.loads((tmp_path / "rounds.json").read_text())
    assert result["faults"] == []
    assert len({one["pid"] for one in result["samples"]}) == 2
    assert len(result["samples"]) > 10
    assert (tmp_path / "rounds.svg").exists()
