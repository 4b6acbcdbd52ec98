"""Measure how closely lockstep runs match real runs of the quadruped.

    python -m benchmarks.lockstep_truth [--runs N] [--seconds S]

Launches the example several times in real time, records its encoders, and compares the joint angles
of the first seconds with lockstep runs, at equal simulated times:

- ideal: nothing takes time, all nodes are active at time 0;
- measured: nodes are activated at the times of the real run, messages take 1 or 2 ms;
- fitted: the controller is activated when it fits the real run best, messages take 1 ms;
- varied: random schedules with seeds 1 to 3.

The distance between two real runs is the best that lockstep can achieve. It writes
`benchmarks/results/lockstep_truth.json` and `lockstep_truth.svg`; exit code 1 if no run with
measured bring-up meets the goal. Nodes report the simulated time of their activation; on a busy
machine their first ticks and the first steps of the simulator are late.
"""

import argparse
import itertools
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.reader import make_reader
from numpy.typing import NDArray
from obelisk_sensor_msgs.msg import ObkJointEncoders

from benchmarks.stolen import StolenTime, warn_of_stolen_time
from obelisk_py.core.lockstep.interception import intercepted
from obelisk_py.core.serialization.codec import codec_for
from obk_testing.programs import LoadedStack, load_stack
from obk_testing.schedule import Schedule, bring_up_times
from obk_testing.trial import StackTrial

ROOT: Final = Path(__file__).resolve().parents[1]
OBK: Final = Path(sys.executable).with_name("obk")
CONFIG: Final = ROOT / "examples" / "quadruped" / "quadruped.yaml"
RESULTS: Final = ROOT / "benchmarks" / "results"
TOPIC: Final = "/quadruped/encoders"
LATENCIES_S: Final = (0.001, 0.002)
SEEDS: Final = (1, 2, 3)
FITTED_S: Final = tuple(number / 1000 for number in range(2, 61, 2))
"""Activation times of the controller to try [s]."""
ESTIMATOR_EARLIER_S: Final = 0.008
GOAL_RMS_MRAD: Final = 1.0
GOAL_MAX_MRAD: Final = 4.0
LAUNCH_MORE_S: Final = 1.0
"""Extra duration of a launch, because its simulation may fall behind [s]."""
STYLE: Final[Any] = {"svg.hashsalt": "obelisk", "svg.fonttype": "none"}
FITTED: Final = "real, fitted bring-up"
SHOWN: Final = "measured bring-up"
SHOWN_JOINT: Final = "fl_knee"


@dataclass(frozen=True, slots=True, kw_only=True)
class Angles:
    """The joint angles of a run over simulated time."""

    time_us: NDArray[np.int64]
    joints: NDArray[np.float64]
    """[rad], one row per time."""
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Distance:
    """The distance between the joint angles of two runs."""

    rms_mrad: float
    max_mrad: float


def angles_of(messages: Iterable[Any], seconds: float) -> Angles:
    """Extract the joint angles from encoder messages, ordered by their stamps."""
    rows: dict[int, Sequence[float]] = {}
    names: Sequence[str] = ()
    for message in messages:
        time_us = message.stamp.sec * 1_000_000 + message.stamp.nanosec // 1000
        if time_us <= seconds * 1e6:
            rows[time_us], names = message.joint_pos, message.joint_names
    times = sorted(rows)
    return Angles(
        time_us=np.array(times, dtype=np.int64),
        joints=np.array([rows[time_us] for time_us in times]),
        names=tuple(names),
    )


def distance(one: Angles, other: Angles) -> Distance:
    """The distance between two runs, at the times that both have."""
    common, mine, others = np.intersect1d(one.time_us, other.time_us, return_indices=True)
    assert len(common) > 100, "the runs have no times in common"
    apart = np.abs(one.joints[mine] - other.joints[others]) * 1e3
    return Distance(rms_mrad=float(np.sqrt((apart**2).mean())), max_mrad=float(apart.max()))


def launch(folder: Path, seconds: float) -> tuple[Path, Angles]:
    """Run the real stack; return its folder and its joint angles."""
    home = folder / "home"
    before = set(home.glob("runs/quadruped_*"))
    environment = {**os.environ, "OBK_HOME": str(home), "ROS_DOMAIN_ID": "98"}
    environment.pop("ROS_AUTOMATIC_DISCOVERY_RANGE", None)
    duration = f"{seconds + LAUNCH_MORE_S:g}"
    words = [str(OBK), "launch", str(CONFIG), "--duration", duration, "--record-topic", TOPIC]
    subprocess.run(words, env=environment, check=True, stdout=subprocess.DEVNULL, timeout=120)
    (run,) = set(home.glob("runs/quadruped_*")) - before
    codec = codec_for(ObkJointEncoders)
    assert codec is not None
    with (run / "recording.mcap").open("rb") as file:
        records = make_reader(file).iter_messages(topics=[TOPIC])
        return run, angles_of((codec.unpack(message.data) for _, _, message in records), seconds)


def simulate(stack: LoadedStack, schedule: Schedule, seconds: float, seed: int = 0) -> Angles:
    """Run the stack in lockstep."""
    with StackTrial(stack, seed=seed, schedule=schedule, record=[TOPIC]) as trial:
        return angles_of(trial.run(seconds).topics[TOPIC], seconds)


def mean(distances: Sequence[Distance]) -> dict[str, float]:
    """The mean of both measures over all runs."""
    return {
        name: round(statistics.fmean(getattr(each, name) for each in distances), 3)
        for name in ("rms_mrad", "max_mrad")
    }


def measure(folder: Path, runs: int, seconds: float) -> tuple[dict[str, Any], Mapping[str, Angles]]:
    """Make all comparisons; return the result and the runs to plot."""
    stolen = StolenTime()
    real = [launch(folder, seconds) for _ in range(runs)]
    stolen_percent = stolen.percent()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "OFF"
    with intercepted():
        stack = load_stack(CONFIG)
        ideal = simulate(stack, Schedule(), seconds)
        compared: dict[str, list[Distance]] = {
            "two real runs": [distance(a, b) for (_, a), (_, b) in itertools.combinations(real, 2)],
            "real, ideal": [distance(angles, ideal) for _, angles in real],
        }
        bring_ups = [bring_up_times(run, stack.plan) for run, _ in real]
        modelled = {
            latency_s: [
                simulate(stack, Schedule(bring_up=times, latency=latency_s), seconds)
                for times in bring_ups
            ]
            for latency_s in LATENCIES_S
        }
        for latency_s, simulated in modelled.items():
            compared[_modelled(latency_s)] = [
                distance(angles, one) for (_, angles), one in zip(real, simulated, strict=True)
            ]
        tried = {control_s: simulate(stack, _fitted(control_s), seconds) for control_s in FITTED_S}
        fitted = [_nearest(angles, tried) for _, angles in real]
        compared[FITTED] = [
            distance(angles, tried[control_s])
            for (_, angles), control_s in zip(real, fitted, strict=True)
        ]
        names = [node.planned.full_name for node in stack.nodes if not node.planned.model]
        varied = [simulate(stack, Schedule.varied(s, names), seconds, s) for s in SEEDS]
        compared["real, varied by seed"] = [
            distance(angles, one) for _, angles in real for one in varied
        ]
        compared["ideal, varied by seed"] = [distance(ideal, one) for one in varied]
        stack.close()
    result = {
        "runs": runs,
        "seconds": seconds,
        "mean": {name: mean(distances) for name, distances in compared.items()},
        "each": {name: list(map(asdict, distances)) for name, distances in compared.items()},
        "fitted_control_ms": [round(control_s * 1e3) for control_s in fitted],
        "bring_up_ms": [
            {name: round(time_s * 1e3, 2) for name, time_s in times.items()} for times in bring_ups
        ],
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "load_average": round(os.getloadavg()[0], 1),
        "stolen_percent": stolen_percent,
    }
    shown = {"real": real[0][1], SHOWN: modelled[LATENCIES_S[0]][0], "ideal": ideal}
    return result, shown


def _fitted(control_s: float) -> Schedule:
    estimation_s = max(0.0, control_s - ESTIMATOR_EARLIER_S)
    bring_up = {"control": control_s, "estimation": estimation_s}
    return Schedule(bring_up=bring_up, latency=LATENCIES_S[0])


def _nearest(real: Angles, tried: Mapping[float, Angles]) -> float:
    return min(tried, key=lambda control_s: distance(real, tried[control_s]).rms_mrad)


def _modelled(latency_s: float) -> str:
    return f"real, measured bring-up and {latency_s * 1e3:g} ms"


def draw(shown: Mapping[str, Angles], path: Path) -> None:
    """Plot one joint of the runs, and the distance of lockstep from the real run."""
    import matplotlib as mpl

    mpl.use("svg")
    from matplotlib import pyplot

    real = shown["real"]
    joint = next(i for i, name in enumerate(real.names) if name.startswith(SHOWN_JOINT))
    colours = {"real": "black", SHOWN: "tab:blue", "ideal": "tab:orange"}
    with pyplot.rc_context(STYLE):
        figure, (above, below) = pyplot.subplots(2, 1, sharex=True, figsize=(7, 4.6))
        for name, run in shown.items():
            above.plot(
                run.time_us / 1e6,
                run.joints[:, joint],
                color=colours[name],
                label=name,
                linestyle="--" if name == SHOWN else "-",
                linewidth=1.2,
            )
            if name == "real":
                continue
            _, mine, others = np.intersect1d(run.time_us, real.time_us, return_indices=True)
            apart = (run.joints[mine, joint] - real.joints[others, joint]) * 1e3
            below.plot(run.time_us[mine] / 1e6, apart, color=colours[name], linewidth=1.2)
        above.set_ylabel(f"{SHOWN_JOINT} [rad]")
        above.legend(frameon=False)
        below.set_ylabel("lockstep - real [mrad]")
        below.set_xlabel("simulated time [s]")
        figure.tight_layout()
        figure.savefig(path, metadata={"Date": None})
        pyplot.close(figure)


def main() -> int:
    """Measure, print and write the result."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.lockstep_truth",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--runs", type=int, default=5, help="real launches")
    parser.add_argument("--seconds", type=float, default=2.0, help="compared [s]")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the results")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        result, shown = measure(Path(folder), options.runs, options.seconds)
    options.results.mkdir(parents=True, exist_ok=True)
    path = options.results / "lockstep_truth.json"
    path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    draw(shown, options.results / "lockstep_truth.svg")
    print(f"joints over {options.seconds:g} s, mean of {options.runs} real runs [mrad]")
    for name, means in result["mean"].items():
        print(f"  {name:<36} rms {means['rms_mrad']:7.3f}   max {means['max_mrad']:7.3f}")
    warn_of_stolen_time(result["stolen_percent"])
    reached = [result["mean"][_modelled(latency_s)] for latency_s in LATENCIES_S]
    is_near = any(
        each["rms_mrad"] <= GOAL_RMS_MRAD and each["max_mrad"] <= GOAL_MAX_MRAD for each in reached
    )
    return 0 if is_near else 1


if __name__ == "__main__":
    sys.exit(main())
