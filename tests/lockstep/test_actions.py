"""Actions in lockstep: goals, feedback, cancel, results, and servers that are missing."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus

from obk_interfaces import build, discover

pytestmark = pytest.mark.ros

ROOT = Path(__file__).parents[2]
MANIFEST = """<package format="3"><name>user_msgs</name><version>1.0.0</version></package>"""
ACTION = "float64 distance\n---\nbool done\n---\nfloat64 walked\n"
SUCCEEDED, CANCELED, ABORTED = (
    GoalStatus.STATUS_SUCCEEDED,
    GoalStatus.STATUS_CANCELED,
    GoalStatus.STATUS_ABORTED,
)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The record of each scenario, by its name."""
    folder = tmp_path_factory.mktemp("actions")
    source, overlay = folder / "source", folder / "overlay"
    (source / "action").mkdir(parents=True)
    (source / "package.xml").write_text(MANIFEST)
    (source / "action" / "Walk.action").write_text(ACTION)
    build(
        discover([source]),
        build_dir=folder / "build",
        prefix=overlay,
        underlays=[Path(sys.prefix)],
    )
    done = subprocess.run(
        [sys.executable, "-m", "tests.lockstep.action_scenarios"],
        cwd=ROOT,
        env={**os.environ, "OBK_OVERLAY_PATH": str(overlay)},
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def test_a_goal_has_feedback_and_a_result(results: dict[str, Any]) -> None:
    assert results["goal"] == {
        "seen": [[0.5, "accepted"], [0.6, 1.0], [0.7, 2.0], [0.7, [SUCCEEDED, True]]],
        "notes": [],
    }


def test_each_way_takes_the_latency(results: dict[str, Any]) -> None:
    # The goal and its response take 20 ms; the request for the result arrives while it walks.
    assert results["latency"]["seen"] == [
        [0.52, "accepted"],
        [0.62, 1.0],
        [0.62, [SUCCEEDED, True]],
    ]


def test_a_goal_is_rejected(results: dict[str, Any]) -> None:
    assert results["rejected"]["seen"] == [[0.5, "rejected"]]


def test_a_goal_is_canceled(results: dict[str, Any]) -> None:
    assert results["canceled"]["seen"][-2:] == [[0.8, 3.0], [0.8, [CANCELED, False]]]


def test_a_server_that_raises_aborts_the_goal(results: dict[str, Any]) -> None:
    assert results["raises"]["seen"] == [[0.5, "accepted"], [0.5, [ABORTED, False]]]


def test_a_missing_server_is_noted_and_may_start_later(results: dict[str, Any]) -> None:
    seen, notes = results["no_server"]["seen"], results["no_server"]["notes"]
    assert seen[0] == [1.0, False]
    assert seen[1:] == [[2.0, "accepted"], [2.1, 1.0], [2.1, [SUCCEEDED, True]]]
    assert any("no node serves the action /walk" in note for note in notes)


def test_a_blocking_goal_is_an_error_with_its_location(results: dict[str, Any]) -> None:
    (error,) = results["blocking"]["seen"]
    assert "/client" in error
    assert "action_scenarios.py:" in error
    assert "deadlock" in error
