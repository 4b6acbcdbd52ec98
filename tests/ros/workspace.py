"""A workspace with message packages of a user, and nodes that exchange their messages."""

from pathlib import Path

__all__ = ["MANIFEST", "make_nodes", "make_workspace", "write_files"]

MANIFEST = '<package format="3"><name>{}</name><version>0.1.0</version>{}</package>\n'
MESSAGES = {
    "arm_msgs/package.xml": MANIFEST.format("arm_msgs", "<depend>geometry_msgs</depend>"),
    "arm_msgs/msg/Reach.msg": "float64[] joints  # [rad]\ngeometry_msgs/Point goal\n",
    "task_msgs/package.xml": MANIFEST.format("task_msgs", "<depend>arm_msgs</depend>"),
    "task_msgs/msg/Task.msg": "string name\narm_msgs/Reach[] steps\n",
    "task_msgs/srv/Judge.srv": "Task task\n---\nbool is_done\n",
    "other_msgs/package.xml": MANIFEST.format("other_msgs", ""),
    "other_msgs/msg/Word.msg": "string text\n",
}
NODES = {
    "demo/package.xml": MANIFEST.format("demo", "<depend>task_msgs</depend>"),
    "demo/setup.py": """\
from setuptools import setup

NODES = ("robot", "estimator", "controller")
setup(
    name="demo",
    packages=["demo"],
    entry_points={
        "console_scripts": [
            "robot = demo.nodes:robot",
            "estimator = demo.nodes:estimator",
            "controller = demo.nodes:controller",
        ]
    },
)
""",
    "demo/demo/__init__.py": "",
    "demo/demo/nodes.py": """\
from arm_msgs.msg import Reach
from obelisk_py.core.control import ObeliskController
from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.robot import ObeliskRobot
from obelisk_py.core.utils.ros import spin_obelisk
from task_msgs.msg import Task


class Robot(ObeliskRobot):
    def __init__(self, node_name="robot"):
        super().__init__(node_name, ctrl_msg_type=Reach)
        self.register_obk_publisher("pub_joints_setting", key="pub_joints", msg_type=Reach)
        self.register_obk_timer("timer_joints_setting", self.publish, key="timer_joints")

    def apply_control(self, control_msg):
        self.get_logger().info(f"reached {control_msg.goal.x}", once=True)

    def publish(self):
        self.obk_publishers["pub_joints"].publish(Reach(joints=[1.0, 2.0]))


class Estimator(ObeliskEstimator):
    def __init__(self, node_name="estimator"):
        super().__init__(node_name, est_msg_type=Task)
        self.register_obk_subscription(
            "sub_sensor_setting", self.take, key="sub_sensor", msg_type=Reach
        )
        self.reach = None

    def take(self, msg):
        self.reach = msg

    def compute_state_estimate(self):
        if self.reach is not None:
            self.obk_publishers["pub_est"].publish(Task(name="walk", steps=[self.reach]))


class Controller(ObeliskController):
    def __init__(self, node_name="controller"):
        super().__init__(node_name, ctrl_msg_type=Reach)

    def update_x_hat(self, x_hat_msg):
        self.task = x_hat_msg

    def compute_control(self):
        task = getattr(self, "task", None)
        if task is not None:
            msg = Reach()
            msg.goal.x = sum(task.steps[0].joints)
            self.obk_publishers["pub_ctrl"].publish(msg)


def robot():
    spin_obelisk(None, Robot)


def estimator():
    spin_obelisk(None, Estimator)


def controller():
    spin_obelisk(None, Controller)
""",
}
CONFIG = """\
config: reaching
control:
  pkg: demo
  executable: controller
  publishers: [{key: pub_ctrl, topic: /ctrl, msg_type: arm_msgs/Reach}]
  subscribers: [{key: sub_est, topic: /est, msg_type: task_msgs/Task}]
  timers: [{key: timer_ctrl, timer_period_sec: 0.05}]
estimation:
  pkg: demo
  executable: estimator
  publishers: [{key: pub_est, topic: /est, msg_type: task_msgs/Task}]
  subscribers: [{key: sub_sensor, topic: /joints, msg_type: arm_msgs/Reach}]
  timers: [{key: timer_est, timer_period_sec: 0.05}]
robot:
  is_simulated: false
  pkg: demo
  executable: robot
  publishers: [{key: pub_joints, topic: /joints, msg_type: arm_msgs/Reach}]
  subscribers: [{key: sub_ctrl, topic: /ctrl, msg_type: arm_msgs/Reach}]
  timers: [{key: timer_joints, timer_period_sec: 0.05}]
"""


def make_workspace(folder: Path) -> Path:
    """The message packages: one uses another, a third is independent; one has a service."""
    write_files(folder / "src", MESSAGES)
    return folder


def make_nodes(workspace: Path) -> Path:
    """A package of nodes, and the config that connects them; returns the config's path."""
    write_files(workspace / "src", NODES)
    config = workspace / "stack.yaml"
    config.write_text(CONFIG)
    return config


def write_files(folder: Path, files: dict[str, str]) -> None:
    """Write files below a folder."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
