"""`obk topic`, `node`, `param`, `service` on a node in this process, and on a stack."""

import csv
import io
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from geometry_msgs.msg import PointStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32, String
from std_srvs.srv import SetBool

from .looking import announce_as_a_stack_does, done, error_of, reported
from .stack import DUMMY, eventually, launched, obk, spinning

pytestmark = pytest.mark.ros

TALKER = "/arm/talker"
"""With a full name, the command waits until `--timeout`."""


class Talker(Node):
    """Publishes every 20 ms, on topics of every kind."""

    def __init__(self) -> None:
        super().__init__("talker", namespace="arm")
        weak = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._joints = self.create_publisher(JointState, "joints", weak)
        self._broken = self.create_publisher(PointStamped, "broken", 10)
        self._point = self.create_publisher(PointStamped, "point", 10)
        self.create_publisher(String, "manual", latched).publish(String(data="turn it on"))
        self.create_publisher(Int32, "silent", 1)
        self.received: list[PointStamped] = []
        self.create_subscription(PointStamped, "goal", self.received.append, 10)
        self.create_service(SetBool, "switch", self._switch)
        self.declare_parameter("gain", 1.5)
        self.declare_parameter("limits.upper", [1.0, 2.0])
        self.declare_parameter("name", "arm: left")
        self.declare_parameter("offset", Parameter.Type.DOUBLE)
        self.add_on_set_parameters_callback(self._check)
        self._count = 0
        self.create_timer(0.02, self._talk)

    def _talk(self) -> None:
        self._count += 1
        joints = JointState(name=["a", "b"], position=[0.5, float(self._count)])
        joints.effort = [0.25] * 30
        self._joints.publish(joints)
        self._broken.publish(b"\0\1\0\0")
        point = PointStamped()
        point.header.stamp = self.get_clock().now().to_msg()
        point.point.x = 0.5
        self._point.publish(point)

    def _switch(self, request: Any, response: Any) -> Any:
        response.success = bool(request.data)
        response.message = "on" if request.data else "it stays on"
        return response

    def _check(self, parameters: Any) -> SetParametersResult:
        fits = all(p.value <= 10 for p in parameters if p.name == "gain")
        reason = "" if fits else "the gain is \x1b[1mabove 10"
        return SetParametersResult(successful=fits, reason=reason)


@pytest.fixture(autouse=True)
def _found_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    announce_as_a_stack_does(monkeypatch)


@pytest.fixture
def talker() -> Iterator[Talker]:
    with spinning(Talker) as node:
        yield node


def test_topics_are_listed_and_shown_with_their_ends(talker: Talker) -> None:
    joints = {
        "topic": "/arm/joints",
        "types": ["sensor_msgs/msg/JointState"],
        "publishers": 1,
        "subscriptions": 0,
    }
    # For a node not started by obk, only the messages until then count.
    eventually(lambda: joints in reported("topic", "list"), "the topic with its publisher")
    eventually(lambda: "/arm/joints " in done("topic", "list"), "the topic")
    ends: list[dict[str, str]] = []

    def is_named() -> bool:
        ends[:] = reported("topic", "info", "/arm/manual")["publishers"]
        return [end["node"] for end in ends] == ["/arm/talker"]

    eventually(is_named, "the publisher's node")
    assert ends[0]["durability"] == "transient_local"
    assert ends[0]["type_hash"].startswith("RIHS01_")
    assert "best_effort, volatile" in done("topic", "info", "joints")


def test_messages_are_shown_for_any_offered_qos(talker: Talker) -> None:
    assert done("topic", "echo", "/arm/manual", "--once") == 'data: "turn it on"\n---\n'
    (message, end) = done("topic", "echo", "/arm/joints", "--once").split("---\n")
    assert end == ""
    shown = yaml.safe_load(message)
    assert shown["name"] == ["a", "b"]
    assert shown["effort"][-1] == "... 18 more"
    whole = done("topic", "echo", "/arm/joints", "effort", "--full", "--once")
    assert yaml.safe_load(whole) == [0.25] * 30


@pytest.mark.slow
def test_fields_are_shown_as_text_json_and_csv(talker: Talker) -> None:
    assert done("topic", "echo", "joints", "position[0]", "-n", "2") == "0.5\n0.5\n"
    words = ("topic", "echo", "/arm/joints", "--field", "position", "name[1]", "-n", "3")
    lines = [json.loads(line) for line in done(*words, "--format", "json").splitlines()]
    assert [line["name[1]"] for line in lines] == ["b"] * 3
    rows = list(csv.DictReader(io.StringIO(done(*words, "--csv"))))
    assert [row["position[0]"] for row in rows] == ["0.5"] * 3
    assert list(rows[0]) == ["name[1]", "position[0]", "position[1]"]
    wrong = error_of("topic", "echo", "/arm/joints", "positon")
    assert "`positon`" in wrong
    assert "did you mean `position`" in wrong


@pytest.mark.slow
def test_invalid_bytes_are_reported(talker: Talker) -> None:
    reported = (
        "a message on /arm/broken does not match geometry_msgs/msg/PointStamped as built here"
    )
    assert reported in error_of("topic", "echo", "/arm/broken")
    assert reported in error_of("topic", "delay", "/arm/broken")


@pytest.mark.slow
def test_a_silent_topic_and_a_missing_one_end_with_a_message(
    talker: Talker,
) -> None:
    # On a busy machine, even the topic may not be found that soon.
    eventually(
        lambda: (
            "no message received on /arm/silent within 2 s"
            in error_of("topic", "echo", "silent", "--timeout", "2")
        ),
        "the report of a silent topic",
    )
    missing = f"no topic `jionts` in ROS domain {os.environ['ROS_DOMAIN_ID']}"

    def is_near() -> bool:
        complaint = error_of("topic", "echo", "jionts")
        assert missing in complaint
        return "did you mean `/arm/joints`" in complaint

    eventually(is_near, "the topic that is meant")


def test_an_empty_domain_is_reported_as_empty() -> None:
    for words in (
        ("topic", "list"),
        ("node", "list"),
        ("param", "get", "arm"),
        ("service", "list"),
    ):
        complaint = error_of(*words, is_patient=False)
        assert f"domain {os.environ['ROS_DOMAIN_ID']}" in complaint
        assert "`obk launch`" in complaint


@pytest.mark.slow
def test_delays_are_reported_by_stamps(talker: Talker) -> None:
    delay = reported("topic", "delay", "/arm/point", "--duration", "3")
    assert not delay["is_relative"]
    assert 0 <= delay["min_s"] <= delay["mean_s"] <= delay["max_s"]
    zero = error_of("topic", "delay", "/arm/joints", "--duration", "3")
    assert "/arm/joints are zero" in zero


def test_messages_are_published_once_matched_with_a_subscription(talker: Talker) -> None:
    text = "{header: auto, point: {x: 1, y: -0.5}}"
    output = done("topic", "pub", "goal", text, "-n", "3", "--rate", "100")
    assert output == "published 3 messages on /arm/goal\n"
    eventually(lambda: len(talker.received) == 3, "three messages")
    goal = talker.received[-1]
    assert (goal.point.x, goal.point.y, goal.point.z) == (1.0, -0.5, 0.0)
    assert goal.header.stamp.sec > 1_600_000_000
    wrong = error_of("topic", "pub", "/arm/goal", "{point: {x: a, w: 1}}", "--once", exit_code=2)
    assert "point.x: " in wrong
    assert "point.w: " in wrong
    other = error_of("topic", "pub", "/arm/goal", "std_msgs/msg/String", "{}", "--once")
    assert "type geometry_msgs/msg/PointStamped" in other
    unmatched = error_of(
        "topic", "pub", "/unused", "std_msgs/msg/Int32", "{data: 1}", "--once", "--timeout", "1"
    )
    assert "/unused" in unmatched
    assert len(talker.received) == 3


def test_parameters_are_listed_shown_set_and_dumped(talker: Talker, tmp_path: Path) -> None:
    assert set(reported("param", "list", "talker")[TALKER]) >= {"gain", "limits.upper", "name"}
    assert reported("param", "get", TALKER, "gain", "limits.upper") == {
        "gain": {"type": "double", "value": 1.5},
        "limits.upper": {"type": "double_array", "value": [1.0, 2.0]},
    }
    output = done("param", "set", TALKER, "gain", "2")
    assert output == "/arm/talker: gain changed from 1.5 to 2.0 (double)\n"
    assert talker.get_parameter("gain").value == 2.0
    assert r"\u001b[1mabove 10" in error_of("param", "set", TALKER, "gain", "11")
    of_type = error_of("param", "set", TALKER, "limits.upper", "[a]")
    assert "double_array" in of_type
    assert "[1.0, 2.0]" in of_type
    assert "did you mean `gain`" in error_of("param", "get", TALKER, "gian")
    assert "did you mean `gain`" in error_of("param", "set", TALKER, "gian", "1")
    # Without a value, it must not hide those that have one.
    every = reported("param", "get", TALKER)
    assert every["offset"] == {"type": "not set", "value": None}
    assert every["gain"] == {"type": "double", "value": 2.0}
    no_text = error_of("param", "set", TALKER, "offset", "a")
    assert "double" in no_text
    path = tmp_path / "arm.yaml"
    done("param", "dump", TALKER, "--output", path)
    (dumped,) = yaml.safe_load(path.read_text())[TALKER].values()
    assert dumped["gain"] == 2.0
    assert dumped["name"] == "arm: left"
    assert done("param", "dump", TALKER) == path.read_text()
    assert "offset" not in dumped
    output = done("param", "set", TALKER, "offset", "1")
    assert output == "/arm/talker: offset changed from not set to 1.0 (double)\n"


def test_services_are_listed_and_called(talker: Talker) -> None:
    services: dict[str, list[str]] = {}

    def are_listed() -> bool:
        services.update(reported("service", "list"))
        return services.get("/arm/switch") == ["std_srvs/srv/SetBool"]

    eventually(are_listed, "the service")
    assert not any(name.endswith("get_parameters") for name in services)
    of_node = ("service", "list", "--all", "--node", TALKER)
    eventually(lambda: f"{TALKER}/get_parameters" in reported(*of_node), "a service of every node")

    yes = done("service", "call", "/arm/switch", "{data: true}")
    assert yes == 'success: true\nmessage: "on"\n'
    no = obk("service", "call", "/arm/switch", "{data: false}", "--format", "json")
    assert no.returncode == 1
    assert json.loads(no.stdout) == {"success": False, "message": "it stays on"}
    wrong = error_of("service", "call", "/arm/switch", "{data: 3}", exit_code=2)
    assert "data: " in wrong
    assert "did you mean `/arm/switch`" in error_of("service", "call", "swich")


@pytest.mark.slow
def test_a_stack_can_be_inspected_from_any_domain(monkeypatch: pytest.MonkeyPatch) -> None:
    domain = os.environ["ROS_DOMAIN_ID"]
    # In its first seconds, a launch considers any other publisher of commands a danger.
    with launched(DUMMY, "--quiet", "--allow-foreign"):
        monkeypatch.delenv("ROS_DOMAIN_ID")
        nodes = {node["node"]: node for node in reported("node", "list")}
        assert nodes["/obelisk_control_0"]["state"] == "active"
        info = reported("node", "info", "control_0")
        assert info["pid"] == nodes["/obelisk_control_0"]["pid"]
        assert info["run"].startswith("dummy_")
        assert "/obelisk/dummy/ctrl" in info["publishes"]
        assert "/obelisk/dummy/est" in info["subscribes"]
        assert "/obelisk_control_0/get_state" in info["services"]
        assert info["parameters"] > 3
        ctrl = done("topic", "echo", "ctrl", "u_mujoco[0]", "--once")
        assert -2.0 < float(ctrl) < 2.0
        forbidden = error_of("topic", "pub", "ctrl", "{u_mujoco: [0.0]}", "--once")
        assert (
            "/obelisk/dummy/ctrl commands `/obelisk_robot_0`, which is running in the ROS "
            f"domain {domain}"
        ) in (forbidden)
        assert "`--allow-foreign`" in forbidden
        allowed = obk("topic", "pub", "ctrl", "{u_mujoco: [0.0]}", "--once", "--allow-foreign")
        assert allowed.returncode == 0, allowed.stderr
        assert "dummy in " in error_of("topic", "list", "--domain", "101", "--timeout", "1")
        env = {
            "_OBK_COMPLETE": "complete_bash",
            "COMP_WORDS": "obk topic echo im",
            "COMP_CWORD": "3",
        }
        eventually(lambda: obk(env=env).stdout.split() == ["imu"], "the topic, completed")
        env = {**env, "COMP_WORDS": "obk param get /obelisk_r"}
        eventually(lambda: obk(env=env).stdout.split() == ["/obelisk_robot_0"], "the node")


PARAMETERS = """
import contextlib, sys
from obk_cli.cli.main import main
for words in {commands}:
    with contextlib.suppress(SystemExit):
        main(words.split())
print("rclpy" in sys.modules or "obk_cli.config.model" in sys.modules)
"""


def test_nodes_of_a_stack_are_queried_through_its_launcher_and_others_over_ros(
    talker: Talker,
) -> None:
    with launched(DUMMY, "--quiet"):
        commands = [
            "topic info est --format json",
            "param set control_0 params_path /there",
            "param get control_0 params_path",
            "param list control_0",
            "node info control_0",
        ]
        code = PARAMETERS.format(commands=commands)
        result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert result.stdout.endswith("False\n"), (result.stdout, result.stderr)
        assert 'to "/there" (string)' in result.stdout
        assert 'params_path  string  "/there"' in result.stdout
        assert '"node": "/obelisk_estimation_0"' in result.stdout
        assert "no parameter `gain`" in error_of("param", "get", "control_0", "gain")
        assert done("param", "get", "talker", "gain").split() == ["gain", "double", "1.5"]
        assert reported("node", "info", "talker")["parameters"] > 3


def test_inspecting_imports_no_generators_of_types() -> None:
    code = """
import sys
from obk_cli.ros.environment import ros_environment
from obk_cli.ros.participant import open_participant
with open_participant(ros_environment(), ("rosidl_generator_py", "std_msgs.msg")):
    assert "std_msgs.msg" in sys.modules
    assert "lark" not in sys.modules
import rosidl_generator_py.generate_py_impl
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
