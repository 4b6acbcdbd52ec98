"""Compare and export long recordings: 10 min of four topics at 1 kHz with 12 joints.

    python benchmarks/recorded_runs.py [--seconds S]

Writes two recordings, then runs `obk diff` on both and `obk export` on one. Wall time, CPU time and
memory of each go to `benchmarks/results/recorded_runs.json`. Exit code 1 if a command takes longer
than 30 s or uses more than 1 GiB.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from obelisk_control_msgs.msg import PDFeedForward
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import ObkImu, ObkJointEncoders

from obelisk_py.core.messages import message_name
from obelisk_py.core.serialization.codec import codec_for
from obk_cli.record.mcap_writer import BagWriter
from obk_cli.record.recorder import installed_definition, schema_text

ROOT = Path(__file__).resolve().parents[1]
OBK = Path(sys.executable).with_name("obk")
RESULT = ROOT / "benchmarks" / "results" / "recorded_runs.json"
NAMES = [f"leg{leg}_joint{joint}" for leg in range(4) for joint in range(3)]
RATE_HZ = 1000
MOST_S = 30.0
MOST_BYTES = 1 << 30


def write(path: Path, seconds: int, seed: int) -> None:
    """Write a recording of random joint positions."""
    zeros = np.zeros(len(NAMES))
    messages: dict[str, Any] = {
        "est": EstimatedState(joint_names=NAMES, q_joints=zeros, v_joints=zeros),
        "ctrl": PDFeedForward(joint_names=NAMES, u_mujoco=zeros, pos_target=zeros),
        "joint_encoders": ObkJointEncoders(joint_names=NAMES, joint_pos=zeros, joint_vel=zeros),
        "imu": ObkImu(),
    }
    numbers = np.random.default_rng(seed)
    with BagWriter(path) as writer:
        topics = []
        for name, message in messages.items():
            message_class: Any = type(message)
            kind = message_name(message_class)
            text = schema_text(kind, installed_definition) or ""
            channel = writer.add_topic(f"/big/{name}", kind, text, {})
            codec: Any = codec_for(message_class)
            topics.append((channel, message, codec))
        for number in range(seconds * RATE_HZ):
            joints = numbers.normal(size=len(NAMES))
            messages["est"].q_joints = messages["ctrl"].pos_target = joints
            messages["joint_encoders"].joint_pos = joints
            messages["imu"].angular_velocity.x = float(joints[0])
            time_ns = 10**18 + number * 1_000_000 + round(abs(joints[1]) * 1e5)
            for channel, message, codec in topics:
                writer.add_message(channel, codec.pack(message), time_ns, time_ns, number)


def measured(*words: object) -> dict[str, float]:
    """Measure time and memory of a command."""
    start_s = time.monotonic()
    process = subprocess.Popen([OBK, *map(str, words)], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"obk {words[0]} failed")
    return {
        "wall_s": time.monotonic() - start_s,
        "processor_s": usage.ru_utime + usage.ru_stime,
        "memory_bytes": usage.ru_maxrss * 1024,
    }


def main() -> int:
    """Measure, print and write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=600)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first, second = folder / "first.mcap", folder / "second.mcap"
        write(first, options.seconds, 1)
        write(second, options.seconds, 2)
        commands = {
            "diff": measured("diff", first, second),
            **{
                form: measured("export", first, "--to", form, "-o", folder / form)
                for form in ("parquet", "csv")
            },
        }
    facts = {
        "seconds": options.seconds,
        "load_average": os.getloadavg()[0],
        "cores": os.cpu_count(),
        "machine": platform.machine(),
    }
    text = json.dumps({**facts, **commands}, indent=1)
    RESULT.write_text(text + "\n", encoding="utf-8")
    print(text)
    worst = commands.values()
    is_good = all(one["wall_s"] < MOST_S and one["memory_bytes"] < MOST_BYTES for one in worst)
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
