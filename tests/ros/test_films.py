"""Videos of running stacks are readable, and failures to record are reported."""

from pathlib import Path

import av
import numpy as np
import pytest

from .opengl import require_opengl
from .stack import DUMMY, eventually, launched, obk

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

PATIENT = ("--hang-after", "0", "--quiet")
"""OpenGL opens while the robot is configured, which takes long on a busy machine."""
ORANGE = (240, 140, 50)
"""The rod that swings."""


def orange(pixels: np.ndarray) -> np.ndarray:
    return np.abs(pixels.astype(int) - ORANGE).sum(axis=2) < 120


@pytest.mark.slow
def test_a_launch_leaves_a_film_of_its_robot(tmp_path: Path) -> None:
    require_opengl()
    path = tmp_path / "out.mp4"
    words = ("--render", path, "--render-camera", "overview", "--render-size", "160x120", *PATIENT)
    result = obk("launch", DUMMY, *words, "--duration", "3", "--color", "never")
    assert result.returncode == 0, result.stdout + result.stderr
    lines = result.stdout.splitlines()
    assert lines[-1] == "stopped cleanly"
    (reported,) = (line for line in lines if line.startswith("video: "))
    assert reported.startswith(f"video: {path}, ")
    with av.open(path) as film:
        stream = film.streams.video[0]
        assert (stream.width, stream.height) == (160, 120)
        assert stream.duration is not None
        assert stream.time_base is not None
        seconds = float(stream.duration * stream.time_base)
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(stream)]
    assert f", {len(frames)} frame" in reported
    assert float(reported.split(", ")[2].removesuffix(" s")) == pytest.approx(seconds, abs=0.06)
    assert all(orange(frame).sum() > 20 for frame in frames)
    assert [path.name for path in tmp_path.iterdir()] == ["out.mp4"]


@pytest.mark.slow
def test_a_killed_launcher_leaves_a_complete_film_or_none(tmp_path: Path) -> None:
    require_opengl()
    path = tmp_path / "out.mp4"
    with launched(DUMMY, "--render", path, "--render-size", "160x120", *PATIENT) as run:
        run.process.kill()
        eventually(lambda: not run.left_over(), f"the end of {run.descendants}")
    left = list(tmp_path.iterdir())
    assert left in ([], [path])
    if left:
        with av.open(path) as film:
            assert next(film.decode(video=0)).width == 160


def test_a_film_that_cannot_be_recorded_prevents_the_start(tmp_path: Path) -> None:
    films = f'onboard.robot[0].params.render="{tmp_path}/none/out.mp4"'
    result = obk("launch", DUMMY, "--set", films, "--duration", "1", "--color", "never")
    assert result.returncode == 1
    assert "no video" in result.stdout
    assert "active" not in result.stdout.replace("inactive", "")
