import os
import random
import threading
import time
import uuid
from datetime import datetime
from pathlib import Path

import numpy as np
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from std_srvs.srv import Trigger

from lockstep_py.controller import Controller
from obelisk_py.core.utils.ros import spin_obelisk


class Joint:
    def __init__(self, name: str) -> None:
        self.name = name

    def __hash__(self) -> int:
        return hash(self.name) ^ 1

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Joint) and id(self) == id(other)


class RepeatableController(Controller):
    """Uses all that lockstep runs simulate: clocks, randomness, services, latched topics."""

    def __init__(self, node_name: str = "repeatable") -> None:
        super().__init__(node_name)
        self.group = ReentrantCallbackGroup()
        latched = QoSProfile(
            depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration()
        )
        self.text = self.create_publisher(String, "~/text", latched)
        self.reset = self.create_client(Trigger, "~/reset", callback_group=self.group)
        self.create_timer(0.1, self.report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.create_timer(0.1, self.ask, callback_group=self.group)
        self.lock = threading.Lock()
        self.random = np.random.default_rng()
        self.joints: set[str] = set()
        self.numbers = {1, 2, 3}
        self.started = time.time(), time.monotonic(), time.perf_counter(), datetime.now()

    def report(self) -> None:
        time.sleep(0.001)
        self.create_rate(100.0).sleep()
        gain = self.get_parameter("gain").value * self.random.normal() + random.random()
        number = uuid.uuid4().int + int.from_bytes(os.urandom(2))
        with self.lock, Path("/dev/null").open("w") as nowhere:
            print(gain, number, np.random.rand(), file=nowhere)
        for name in sorted(self.joints):
            self.text.publish(String(data=name))
        total = sum(number for number in self.numbers)
        self.joints = {str(number) for number in range(total)}

    async def ask(self) -> None:
        await self.reset.call_async(Trigger.Request())
        self.reset.call_async(Trigger.Request()).add_done_callback(self.answered)

    def answered(self, future: object) -> None:
        self.get_logger().info(f"answered: {id(future)}")


def main() -> None:
    spin_obelisk(None, RepeatableController)
