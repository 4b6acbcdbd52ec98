"""A short soak: every trouble once, answered as the rules say, and nothing left; a few rounds."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from .stack import DUMMY

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def results(module: str, *options: str, root: Path, folder: Path) -> dict[str, Any]:
    """What a program of the soak, run on the calm example, wrote into a folder.

    Not whether it found growth: that a short run says nothing of.
    """
    command = (sys.executable, "-m", module, *options, "--config", DUMMY, "--results", folder)
    ended = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    found = list(folder.glob("*.json"))
    assert len(found) == 2, ended.stderr
    outcome, samples = (json.loads(path.read_text()) for path in sorted(found))
    return {**outcome, **samples}


def test_every_trouble_is_answered_as_the_rules_say_and_nothing_is_left(
    repository: Path, tmp_path: Path
) -> None:
    # Neither rates nor hangs: whoever tests beside this one takes the processor.
    asked = ("--seconds", "1", "--calm", "0.5", "--hang-after", "20", "--without-rates")
    result = results("benchmarks.soak", *asked, root=repository, folder=tmp_path)
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
    result = results("benchmarks.soak.rounds", "--rounds", "10", root=repository, folder=tmp_path)
    assert result["faults"] == []
    assert len({one["pid"] for one in result["samples"]}) == 2
    assert len(result["samples"]) > 10
    assert (tmp_path / "rounds.svg").exists()
