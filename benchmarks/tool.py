"""Measure the command line, compared with check-jsonschema on the same files and schema.

    python -m benchmarks.tool PEER [--repeats N]

PEER is the path of a `check-jsonschema` executable. Every run is a new process; the commands take
turns, so that other load on the machine affects all of them. Medians and quartiles go to
`benchmarks/results/tool.json`.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.stolen import StolenTime, warn_of_stolen_time

ROOT = Path(__file__).resolve().parents[1]
OBK = Path(sys.executable).with_name("obk")
SCHEMA = ROOT / "schema" / "obelisk.schema.json"
DUMMY = ROOT / "examples" / "dummy" / "dummy.yaml"
RESULT = ROOT / "benchmarks" / "results" / "tool.json"
STACKS = 334
VARIABLES = 58
"""Environment variables of each node, to give the file a realistic length."""

NODE = """\
  - pkg: obelisk_{section}_py
    executable: {executable}
    name: n{index}
    namespace: robot_{index}
    env:
{env}
"""
ENDS = {
    "control": """\
    publishers:
      - {{ros_parameter: pub_ctrl_setting, topic: ctrl, msg_type: PositionSetpoint}}
    subscribers:
      - {{ros_parameter: sub_est_setting, topic: est, msg_type: EstimatedState}}
    timers:
      - {{ros_parameter: timer_ctrl_setting, timer_period_sec: 0.002}}
""",
    "estimation": """\
    publishers:
      - {{ros_parameter: pub_est_setting, topic: est, msg_type: EstimatedState}}
    subscribers:
      - {{ros_parameter: sub_sensor_setting, topic: joints, msg_type: JointEncoders}}
    timers:
      - {{ros_parameter: timer_est_setting, timer_period_sec: 0.002}}
""",
    "robot": """\
    subscribers:
      - {{ros_parameter: sub_ctrl_setting, topic: ctrl, msg_type: PositionSetpoint}}
    sim:
      model_xml_path: {model}
      sensor_settings:
        - topic: joints
          dt: 0.002
          msg_type: JointEncoders
          sensor_names: {{joint_pos: jointpos, joint_vel: jointvel}}
""",
}
EXECUTABLES = {
    "control": ("control", "example_position_setpoint_controller"),
    "estimation": ("estimation", "jointencoders_passthrough_estimator"),
    "robot": ("sim", "obelisk_mujoco_robot"),
}


def big_config() -> str:
    """A config of about 1,000 nodes in 3 MB, all of them valid."""
    lines = "\n".join(f"      SETTING_{n}: a value of the usual length" for n in range(VARIABLES))
    parts = ["config: big\n"]
    for section, ends in ENDS.items():
        package, executable = EXECUTABLES[section]
        parts.append(f"{section}:\n")
        for index in range(STACKS):
            node = NODE.format(section=package, executable=executable, index=index, env=lines)
            parts.append(node + ends.format(model=DUMMY.with_suffix(".xml")))
    return "".join(parts)


@dataclass(frozen=True, slots=True)
class Cost:
    """Time and memory of one process."""

    seconds: float
    megabytes: float
    """Peak memory."""


def cost(command: list[str], environment: Mapping[str, str]) -> Cost:
    """Run a command in a new process; exit if the command fails."""
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=dict(environment), cwd=ROOT)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    return Cost(seconds, usage.ru_maxrss / 1024)


def measured(peer: str, repeats: int, folder: Path) -> dict[str, list[Cost]]:
    """Measure every command, in turns."""
    big = folder / "big.yaml"
    big.write_text(big_config(), encoding="utf-8")
    kept = {**os.environ, "XDG_CACHE_HOME": str(folder / "kept")}
    check = [peer, "--schemafile", str(SCHEMA)]
    kinds = {
        "obk --help": [str(OBK), "--help"],
        "obk validate dummy": [str(OBK), "validate", str(DUMMY)],
        "obk validate dummy, empty cache": [str(OBK), "validate", str(DUMMY)],
        "check-jsonschema dummy": [*check, str(DUMMY)],
        "obk validate big": [str(OBK), "validate", str(big)],
        "check-jsonschema big": [*check, str(big)],
    }
    times: dict[str, list[Cost]] = {kind: [] for kind in kinds}
    for repeat in range(repeats + 1):
        for kind, command in kinds.items():
            environment = kept
            if "empty cache" in kind:
                environment = {**kept, "XDG_CACHE_HOME": str(folder / f"empty{repeat}")}
            taken = cost(command, environment)
            if repeat:  # the first round fills the caches of the file system and of obk
                times[kind].append(taken)
    return times


def report(times: Mapping[str, list[Cost]], repeats: int, big_bytes: int) -> dict[str, object]:
    """Summarize all runs, each command next to its peer."""
    rows: dict[str, dict[str, Any]] = {
        kind: {
            "median_s": round(statistics.median(c.seconds for c in costs), 3),
            "quartiles_s": [
                round(q, 3) for q in statistics.quantiles((c.seconds for c in costs), n=4)[::2]
            ],
            "most_megabytes": round(max(c.megabytes for c in costs)),
        }
        for kind, costs in times.items()
    }
    ratios = {
        name: round(
            rows[f"obk validate {name}"]["median_s"] / rows[f"check-jsonschema {name}"]["median_s"],
            3,
        )
        for name in ("dummy", "big")
    }
    return {
        "repeats": repeats,
        "python": platform.python_version(),
        "cores": os.cpu_count(),
        "big": {"nodes": STACKS * len(ENDS), "megabytes": round(big_bytes / 1e6, 2)},
        "runs": rows,
        "obk over check-jsonschema": ratios,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("peer", help="path of a check-jsonschema executable")
    parser.add_argument("--repeats", type=int, default=9)
    given = parser.parse_args()
    stolen = StolenTime()
    with tempfile.TemporaryDirectory() as name:
        times = measured(given.peer, given.repeats, Path(name))
    stolen_percent = stolen.percent()
    warn_of_stolen_time(stolen_percent)
    result = {
        "stolen_percent": stolen_percent,
        **report(times, given.repeats, len(big_config().encode())),
    }
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
