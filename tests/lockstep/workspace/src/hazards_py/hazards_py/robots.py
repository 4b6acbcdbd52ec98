"""Robots: a simulator with its own thread, and a hardware driver."""

import time

from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_sensor_msgs.msg import JointEncoders

from obelisk_py.core.robot import ObeliskRobot, ObeliskSimRobot
from obelisk_py.core.utils.ros import spin_obelisk

STEP_S = 0.005


class Simulator(ObeliskSimRobot):
    """A first-order joint; its `loop` parameter selects how the loop waits for the next step."""

    def __init__(self, node_name="simulator"):
        super().__init__(node_name, PositionSetpoint)
        self.declare_parameter("loop", "sleep")
        self.register_obk_publisher("pub_enc_setting", key="pub_enc", msg_type=JointEncoders)
        self.q, self.u = 0.0, 0.0
        self.applied = []

    def apply_control(self, control_msg):
        self.u = control_msg.u_mujoco[0]
        self.applied.append((self.t, self.u))
        self._set_shared_ctrl([self.u])

    def apply_damping(self):
        self.applied.append((self.t, "damped"))

    def run_simulator(self):
        loop = self.get_parameter("loop").value
        if loop == "existing":
            self.step_for_ever()
        stop = self.simulator_stop
        while not stop.is_set():
            self.step(self.u)
            if loop == "sleep":
                time.sleep(STEP_S)
            elif loop == "wait":
                stop.wait(STEP_S)
            elif loop == "raise" and self.t > 0.1:
                raise ValueError("the simulation diverges")
            elif loop == "raise":
                time.sleep(STEP_S)

    def step_for_ever(self):
        while True:
            with self.lock:
                u = self.shared_ctrl[0] if self.shared_ctrl else 0.0
            self.step(u)
            time.sleep(STEP_S)

    def step(self, u):
        self.q += 0.1 * (u - self.q)
        self.obk_publishers["pub_enc"].publish(JointEncoders(y=[self.q]))


class Drive(ObeliskRobot):
    """A robot that only the config can declare as simulated."""

    def __init__(self, node_name="drive"):
        super().__init__(node_name, PositionSetpoint)
        self.register_obk_publisher("pub_enc_setting", key="pub_enc", msg_type=JointEncoders)
        self.create_timer(STEP_S, self.publish_position)
        self.q = 0.0

    def on_configure(self, state):
        open_drives.append(self.get_name())
        return super().on_configure(state)

    def publish_position(self):
        if self.state_label == "active":
            self.obk_publishers["pub_enc"].publish(JointEncoders(y=[self.q]))

    def apply_control(self, control_msg):
        self.q = control_msg.u_mujoco[0]


open_drives = []


def simulator(args=None):
    """Run the simulator."""
    spin_obelisk(args, Simulator)


def drive(args=None):
    """Run the driver."""
    spin_obelisk(args, Drive)
