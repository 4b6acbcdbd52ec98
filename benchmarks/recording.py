"""Record many topics at a high rate and count the messages missing from the file.

    python benchmarks/recording.py [--topics N] [--rate HZ] [--seconds S]

One process publishes encoder messages of 12 joints, and `obk record` records them. Published and
recorded messages, reported losses, the CPU use of the recorder and the load of the machine go to
`benchmarks/results/recording.json`. Exit code 1 if any message was lost.
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

import psutil

from obk_cli.ros.environment import AS_THE_PROFILE_SAYS, LOCALHOST_PROFILE

ROOT = Path(__file__).resolve().parents[1]
OBK = Path(sys.executable).with_name("obk")
RESULT = ROOT / "benchmarks" / "results" / "recording.json"
JOINTS = 12
MATCH_S = 60.0
"""Time by which every publisher must be matched with a subscription [s]."""
SETTLE_S = 0.5
"""Extra wait after that, because the subscription may be matched later [s]."""


def publish(topics: int, rate_hz: float, seconds: float) -> None:
    """Publish on all topics on an absolute schedule; print the number of messages per topic."""
    import rclpy
    from obelisk_sensor_msgs.msg import ObkJointEncoders
    from rclpy.publisher import Publisher
    from rclpy.serialization import serialize_message

    rclpy.init()
    node = rclpy.create_node("load")
    message = ObkJointEncoders(joint_names=[f"joint_{n}" for n in range(JOINTS)])
    publishers: list[Publisher] = [
        node.create_publisher(ObkJointEncoders, f"/load/t{n:02}", 10) for n in range(topics)
    ]
    end = time.monotonic() + MATCH_S
    while not all(publisher.get_subscription_count() for publisher in publishers):
        if time.monotonic() > end:
            raise SystemExit(f"no node subscribed to every topic within {MATCH_S:g} s")
        time.sleep(0.01)
    time.sleep(SETTLE_S)
    count = round(seconds * rate_hz)
    start = time.monotonic()
    for number in range(count):
        message.joint_pos = [number * 1e-3 + joint for joint in range(JOINTS)]
        message.joint_vel = [number * 1e-6 + joint for joint in range(JOINTS)]
        data = serialize_message(message)
        for publisher in publishers:
            publisher.publish(data)
        time.sleep(max(0.0, start + (number + 1) / rate_hz - time.monotonic()))
    took_s = time.monotonic() - start
    print(json.dumps({"each": count, "seconds": took_s}))
    time.sleep(1.0)


def measure(topics: int, rate_hz: float, seconds: float, folder: Path) -> dict[str, object]:
    """Run a publisher and a recorder once."""
    path = folder / "load.mcap"
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": "99",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": AS_THE_PROFILE_SAYS,
        "FASTRTPS_DEFAULT_PROFILES_FILE": LOCALHOST_PROFILE,
        "OBK_HOME": str(folder),
    }
    recorder = psutil.Popen(
        [OBK, "record", "/load/*", "-o", path],
        env=environment,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
    )
    recorder.stderr.readline()
    words = (str(topics), str(rate_hz), str(seconds))
    published = subprocess.run(
        [sys.executable, __file__, "--publish", *words],
        env=environment,
        stdout=subprocess.PIPE,
        check=True,
        timeout=seconds * 5 + 60,
    )
    used = recorder.cpu_times()
    recorder.send_signal(2)
    recorder.wait(20)
    reported = json.loads(published.stdout)
    bag = json.loads(
        subprocess.run(
            [OBK, "bag", "info", path, "--format", "json"], stdout=subprocess.PIPE, check=True
        ).stdout
    )
    return {
        "topics": topics,
        "rate_hz": reported["each"] / reported["seconds"],
        "published": reported["each"] * topics,
        "recorded": bag["count"],
        "told_as_lost": sum(topic["lost"] for topic in bag["topics"]),
        "recorder_cores": (used.user + used.system) / reported["seconds"],
        "file_mb_per_s": bag["size_bytes"] / 1e6 / reported["seconds"],
        "load_average": os.getloadavg()[0],
        "cores": os.cpu_count(),
        "machine": platform.machine(),
    }


def main() -> int:
    """Measure, print and write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--topics", type=int, default=20)
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--publish", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.publish:
        topics, rate_hz, seconds = options.publish
        publish(int(topics), float(rate_hz), float(seconds))
        return 0
    with tempfile.TemporaryDirectory() as folder:
        result = measure(options.topics, options.rate, options.seconds, Path(folder))
    text = json.dumps(result, indent=1)
    RESULT.write_text(text + "\n", encoding="utf-8")
    print(text)
    return 0 if result["published"] == result["recorded"] else 1


if __name__ == "__main__":
    sys.exit(main())
