"""Packages of nodes of each generation of the Python API, and a config that connects them."""

from pathlib import Path
from string import Template

from .workspace import MANIFEST, write_files

__all__ = ["GENERATIONS", "make_stack"]

_SETUP = """\
from setuptools import setup

setup(
    name="{0}",
    packages=["{0}"],
    entry_points={{
        "console_scripts": [
            "robot = {0}.nodes:robot",
            "estimator = {0}.nodes:estimator",
            "controller = {0}.nodes:controller",
        ]
    }},
)
"""
_HEAD = """\
from rclpy.executors import SingleThreadedExecutor

from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import ObkJointEncoders

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.robot import ObeliskRobot, ObeliskSimRobot
from obelisk_py.core.utils.ros import spin_obelisk

"""
_TAIL = """

def robot(args=None):
    spin_obelisk(args, Robot, SingleThreadedExecutor)


def estimator(args=None):
    spin_obelisk(args, Estimator, SingleThreadedExecutor)


def controller(args=None):
    spin_obelisk(args, Controller, SingleThreadedExecutor)
"""

_FIRST = """
class Robot(ObeliskRobot):
    def __init__(self, node_name="robot"):
        super().__init__(node_name)
        self.register_obk_publisher("pub_sensor_setting", "pub_sensor", ObkJointEncoders)
        self.register_obk_timer("timer_sensor_setting", self.publish, "timer_sensor")
        self.register_obk_timer("timer_slow_setting", self.publish, None, "timer_period_sec:60")

    def on_configure(self, state):
        result = super().on_configure(state)
        text = self.get_parameter("pub_sensor_setting").value
        fields = dict(field.split(":") for field in text.split(","))
        self.get_logger().info(f"{self.node_name} publishes {fields['topic']}")
        return result

    def apply_control(self, control_msg):
        self.get_logger().info(f"applied {control_msg.u_mujoco[0]}", once=True)

    def publish(self):
        self.obk_publishers["pub_sensor"].publish(ObkJointEncoders(joint_pos=[1.0]))


class Estimator(ObeliskEstimator):
    def __init__(self, node_name="estimator"):
        super().__init__(node_name)
        self.register_obk_subscription(
            "sub_sensor_setting", self.take, key="subscriber_sensor", msg_type=ObkJointEncoders
        )
        self.joints = None

    def take(self, msg):
        self.joints = msg.joint_pos

    def compute_state_estimate(self):
        msg = EstimatedState()
        if self.joints is not None:
            msg.x_hat = [2 * joint for joint in self.joints]
            self.obk_publishers["publisher_est"].publish(msg)
        return msg


class Controller(ObeliskController):
    def __init__(self, node_name="controller"):
        super().__init__(node_name)
        self.x_hat = None

    def update_x_hat(self, x_hat_msg):
        self.x_hat = x_hat_msg.x_hat

    def compute_control(self):
        msg = PositionSetpoint()
        if self.x_hat is not None:
            msg.u = [2 * x for x in self.x_hat]
            self.obk_publishers["pub_ctrl"].publish(msg)
        return msg
"""

_NEWER = """
class Robot(ObeliskSimRobot):
    def __init__(self, node_name="robot"):
        super().__init__(node_name, PositionSetpoint)
        self.register_obk_publisher($publisher)
        self.register_obk_timer($timer)
        self.n_u = 1

    def apply_control(self, control_msg):
        self._set_shared_ctrl(control_msg.u_mujoco)

    def run_simulator(self):
        import time

        while True:
            with self.lock:
                ctrl = self.shared_ctrl[0]
            if ctrl:
                self.get_logger().info(f"applied {ctrl}", once=True)
            time.sleep(0.01)

    def publish(self):
        self.obk_publishers["pub_sensor"].publish(ObkJointEncoders(joint_pos=[1.0]))


class Estimator(ObeliskEstimator):
    def __init__(self, node_name="estimator"):
        super().__init__(node_name, EstimatedState)
        self.register_obk_subscription($subscription)
        self.joints = None

    def on_configure(self, state):
        self.register_obk_timer($late_timer)
        return super().on_configure(state)

    def log(self):
        pass

    def take(self, msg):
        self.joints = msg.joint_pos

    def compute_state_estimate(self):
        msg = EstimatedState()
        if self.joints is not None:
            msg.q_joints = [2 * joint for joint in self.joints]
            self.obk_publishers["pub_est"].publish(msg)
        return msg


class Controller(ObeliskController):
    def __init__(self, node_name="controller"):
        super().__init__(node_name, PositionSetpoint, EstimatedState)
        self.x_hat = None

    def update_x_hat(self, x_hat_msg):
        self.x_hat = x_hat_msg.q_joints

    def compute_control(self):
        msg = PositionSetpoint()
        if self.x_hat is not None:
            msg.u_mujoco = [2 * x for x in self.x_hat]
            self.obk_publishers["pub_ctrl"].publish(msg)
        return msg
"""

_SECOND = Template(_NEWER).substitute(
    publisher='"pub_sensor_setting", ObkJointEncoders, "pub_sensor"',
    timer='"timer_sensor_setting", self.publish, "timer_sensor", "timer_period_sec:60"',
    subscription='"sub_sensor_setting", self.take, ObkJointEncoders, key="sub_sensor"',
    late_timer='"timer_log_setting", self.log, default_config_str="timer_period_sec:60"',
)
_THIRD = Template(_NEWER).substitute(
    publisher='"pub_sensor", ObkJointEncoders',
    timer='"timer_sensor", self.publish',
    subscription='"sub_sensor", self.take, ObkJointEncoders',
    late_timer='"timer_log", self.log',
)

GENERATIONS = {"first": _FIRST, "second": _SECOND, "third": _THIRD}

_CONFIG = """\
config: generations
control:
  pkg: {control}
  executable: controller
  publishers: [{{ros_parameter: pub_ctrl_setting, topic: /ctrl, msg_type: PositionSetpoint}}]
  subscribers: [{{ros_parameter: sub_est_setting, topic: /est, msg_type: EstimatedState}}]
  timers: [{{ros_parameter: timer_ctrl_setting, timer_period_sec: 0.05}}]
estimation:
  pkg: {estimation}
  executable: estimator
  publishers: [{{ros_parameter: pub_est_setting, topic: /est, msg_type: EstimatedState}}]
  subscribers: [{{ros_parameter: sub_sensor_setting, topic: /joints, msg_type: ObkJointEncoders}}]
  timers: [{{ros_parameter: timer_est_setting, timer_period_sec: 0.05}}]
robot:
  is_simulated: false
  pkg: {robot}
  executable: robot
  callback_groups: {{sensing: ReentrantCallbackGroup}}
  publishers: [{{ros_parameter: pub_sensor_setting, topic: /joints, msg_type: ObkJointEncoders}}]
  subscribers: [{{ros_parameter: sub_ctrl_setting, topic: /ctrl, msg_type: PositionSetpoint}}]
  timers:
    - {{ros_parameter: timer_sensor_setting, timer_period_sec: 0.05, callback_group: sensing}}
"""


def make_stack(folder: Path, *, robot: str, estimation: str, control: str) -> Path:
    """Write a config with nodes of these generations; return its path."""
    for name, nodes in GENERATIONS.items():
        package = f"{name}_py"
        files = {
            "package.xml": MANIFEST.format(package, ""),
            "setup.py": _SETUP.format(package),
            f"{package}/__init__.py": "",
            f"{package}/nodes.py": _HEAD + nodes + _TAIL,
        }
        write_files(folder / "src" / package, files)
    config = folder / "stack.yaml"
    packages = {"robot": robot, "estimation": estimation, "control": control}
    config.write_text(_CONFIG.format(**{key: f"{name}_py" for key, name in packages.items()}))
    return config
