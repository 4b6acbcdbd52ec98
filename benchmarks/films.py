"""Measure what recording a video costs the simulation of the dummy, which steps at 1 kHz.

    python benchmarks/films.py [--seconds S] [--rounds N]

Runs the stepping thread of the simulated robot without ROS, alternately with and without a video,
so that other load on the machine affects both. The time between two steps, the real-time factor
and the outcome of the video go to `benchmarks/results/films.json`.
"""

import argparse
import json
import os
import platform
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import psutil

from obelisk_py.core.sim.mujoco.control import ControlInbox
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.step_times import MonotonicClock, Pace, SampleTimes
from obelisk_py.core.sim.mujoco.stepper import Stepper, TimedOutput
from obelisk_py.core.sim.mujoco.viewers.video import video_outputs
from obelisk_spec.video import VideoSettings, read_video

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "films.json"
DUMMY = ROOT / "examples" / "dummy" / "dummy.xml"
KEYFRAME = "ic"
SWING_S = 1.0
"""Time constant of the command, so that the robot moves in the video [s]."""


def run(seconds: float, settings: VideoSettings | None) -> dict[str, Any]:
    """Step for some time and return the measurements."""
    model = mujoco.MjModel.from_xml_path(str(DUMMY))
    simulation = Simulation(model, ControlInbox(field="u", size=1, monotonic_s=time.monotonic))
    simulation.reset(KEYFRAME)
    stamps_ns: list[int] = []

    def note(_stamp: object) -> None:
        stamps_ns.append(time.monotonic_ns())
        simulation.data.ctrl[0] = np.sin(simulation.data.time / SWING_S)

    step_s = simulation.step_s
    reported: list[str] = []
    with ExitStack() as closing:
        films = video_outputs(
            simulation,
            settings,
            report=lambda film: reported.append(str(film)),
            on_close=closing.callback,
        )
        film = [p for p in psutil.Process().children() if "video" in p.cmdline()]
        stepper = Stepper(
            simulation,
            pace=Pace(step_s),
            clock=MonotonicClock(),
            outputs=(
                TimedOutput(times=SampleTimes(period_s=1.0, step_s=1.0), publish=note),
                *films,
            ),
            stamp=lambda: 0,
            warn=reported.append,
            report=lambda _: None,
        )
        before_s = cpu_s(film)
        end_s = time.monotonic() + seconds
        stepper.run(lambda: time.monotonic() >= end_s)
        used_s = cpu_s(film) - before_s
    return {
        "stamps_ns": stamps_ns,
        "step_s": step_s,
        "film_cores": used_s / seconds,
        "reported": reported,
    }


def cpu_s(processes: list[psutil.Process]) -> float:
    """CPU time that processes have used so far [s]."""
    return sum(p.cpu_times().user + p.cpu_times().system for p in processes)


def case(name: str, rounds: list[dict[str, Any]]) -> dict[str, Any]:
    """Summarize the rounds of one case."""
    between_ms = np.concatenate([np.diff(one["stamps_ns"]) / 1e6 for one in rounds])
    factors = [
        (len(one["stamps_ns"]) - 1)
        * one["step_s"]
        / (1e-9 * (one["stamps_ns"][-1] - one["stamps_ns"][0]))
        for one in rounds
    ]
    percentiles = {f"p{n:g}": float(np.percentile(between_ms, n)) for n in (50, 99, 99.9)}
    return {
        "case": name,
        "step_ms": 1e3 * rounds[0]["step_s"],
        "between_steps_ms": percentiles | {"max": float(between_ms.max())},
        "realtime_factor": {"mean": float(np.mean(factors)), "min": min(factors)},
        "film_cores": float(np.mean([one["film_cores"] for one in rounds])),
        "films": [
            text.partition(", ")[2]
            for one in rounds
            for text in one["reported"]
            if text.startswith("video: ")
        ],
    }


def main() -> int:
    """Measure, print and write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--rounds", type=int, default=6)
    options = parser.parse_args()
    without, filmed = [], []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(options.rounds):
            without.append(run(options.seconds, None))
            path = f"{folder}/{number}.mp4"
            filmed.append(run(options.seconds, read_video(path, "overview", "", 0)))
    result = {
        "cases": [case("no film", without), case("film, 640x480, 30 frames per second", filmed)],
        "load_average": os.getloadavg()[0],
        "cores": os.cpu_count(),
        "machine": platform.machine(),
    }
    text = json.dumps(result, indent=1)
    RESULT.write_text(text + "\n", encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
