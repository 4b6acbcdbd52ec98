"""Call or answer over ROS; a program.

Run as `python -P -m obk_cli.doctor.discovery_program call|answer PARENT`. `call` publishes
until it is answered, then measures round trips, and prints JSON; `answer` answers until SIGTERM.
Either ends when the process PARENT, which started it, is gone.
"""

import json
import os
import signal
import statistics
import sys
import time
from typing import Any, Final

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import Int64

__all__ = ["answer", "call", "main"]

LONGEST_S: Final = 25
REPEAT_S: Final = 0.05
ROUNDS: Final = 10


def call(node: Node, parent: int) -> dict[str, Any]:
    """Call until answered, then measure round trips; empty if the parent has exited."""
    received: list[int] = []

    def receive(message: Any) -> None:
        received.append(message.data)

    calling = node.create_publisher(Int64, "doctor_call", 10)
    node.create_subscription(Int64, "doctor_answer", receive, 10)
    begin = time.monotonic()
    number = 0
    while not received:
        if os.getppid() != parent:
            return {}
        number += 1
        calling.publish(Int64(data=number))
        rclpy.spin_once(node, timeout_sec=REPEAT_S)
    first_s = time.monotonic() - begin
    trips = []
    for _ in range(ROUNDS):
        number += 1
        sent = time.monotonic()
        calling.publish(Int64(data=number))
        while number not in received:
            rclpy.spin_once(node, timeout_sec=REPEAT_S)
        trips.append(time.monotonic() - sent)
    return {
        "rmw": rclpy.get_rmw_implementation_identifier(),
        "first_answer_s": round(first_s, 3),
        "round_trip_ms": round(1e3 * statistics.median(trips), 3),
    }


def answer(node: Node, parent: int) -> None:
    """Answer every call for as long as the parent process is running."""
    answering = node.create_publisher(Int64, "doctor_answer", 10)
    node.create_subscription(Int64, "doctor_call", answering.publish, 10)
    while os.getppid() == parent:
        rclpy.spin_once(node, timeout_sec=REPEAT_S)


def main(role: str, parent: int) -> None:
    """Play one of the two roles."""
    signal.alarm(LONGEST_S)
    rclpy.init()
    node = rclpy.create_node(f"obk_doctor_{role}")
    try:
        if role == "answer":
            answer(node, parent)
        else:
            print(json.dumps(call(node, parent)), flush=True)
    except ExternalShutdownException:
        pass
    finally:
        node.destroy_node()  # type: ignore[no-untyped-call]
        rclpy.try_shutdown()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
