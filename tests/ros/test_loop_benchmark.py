"""The loop benchmark runs and produces results; their values are not checked."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.mark.parametrize("contestant", ["obelisk nodes", "C on rcl"])
def test_a_second_of_one_contestant_gives_results(
    contestant: str, repository: Path, tmp_path: Path
) -> None:
    asked = ["--quick", "--seconds", "1", "--layouts", "composed", "--results", str(tmp_path)]
    ended = subprocess.run(
        [sys.executable, "-m", "benchmarks.loop", *asked, "--contestants", contestant],
        cwd=repository,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    (row,) = json.loads((tmp_path / "loop.json").read_text())["cases"]
    assert row["case"]["contestant"] == contestant
    assert row["runs"] == 1
    assert row["figures"].keys() >= {"others_percent", "late_p50_us", "latency_p99_ms"}
    for name in ("cpu_percent", "rate_hz", "late_p99_us", "latency_p50_ms"):
        assert row["figures"][name]["median"] > 0, name
    assert contestant in (tmp_path / "loop.md").read_text()


def test_nodes_without_messages_exit_when_their_parent_does(
    repository: Path, tmp_path: Path
) -> None:
    worker = subprocess.Popen(
        [
            *(sys.executable, "-m", "benchmarks.loop.worker", "obelisk nodes", "100", "3"),
            *(str(tmp_path / "record.json"), "est_0"),
        ],
        cwd=repository,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    output, _ = worker.communicate()  # closes its input immediately
    assert worker.returncode == 1
    assert output == b""
    assert not (tmp_path / "record.json").exists()
