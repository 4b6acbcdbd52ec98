"""`obk build` and `obk launch`: messages of a user over DDS; only changed packages are built."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from .stack import DEADLINE_S, OBK, obk, started
from .workspace import make_nodes, make_workspace

pytestmark = pytest.mark.ros

COMPILE_S = 4 * DEADLINE_S
"""Timeout for compiling packages."""
PUBLISHER = """
import sys
import rclpy
from arm_msgs.msg import Reach
from task_msgs.msg import Task
from task_msgs.srv import Judge

rclpy.init()
node = rclpy.create_node("publisher")
publisher = node.create_publisher(Task, "task", 1)
client = node.create_client(Judge, "judge")
assert client.wait_for_service(timeout_sec=60)
task = Task(name="walk", steps=[Reach(joints=[1.0, 2.0])])
answers = []
while not answers:  # the first answer to a client may get lost
    future = client.call_async(Judge.Request(task=task))
    future.add_done_callback(lambda done: answers.append(done.result().is_done))
    for _ in range(20):
        publisher.publish(task)
        rclpy.spin_once(node, timeout_sec=0.1)
        if answers:
            break
print(answers[0])
rclpy.shutdown()
"""
SUBSCRIBER = """
import rclpy
from task_msgs.msg import Task
from task_msgs.srv import Judge

rclpy.init()
node = rclpy.create_node("subscriber")
tasks = []
judged = []
node.create_subscription(Task, "task", tasks.append, 1)

def judge(request, response):
    response.is_done = request.task.steps[0].joints[1] == 2.0
    judged.append(response)
    return response

node.create_service(Judge, "judge", judge)
for _ in range(600):
    rclpy.spin_once(node, timeout_sec=0.1)
    if tasks and judged:
        break
while node.count_publishers("task"):  # the answer may be under way
    rclpy.spin_once(node, timeout_sec=0.1)
print(tasks[0].name, list(tasks[0].steps[0].joints))
rclpy.shutdown()
"""


TYPE_HASH = """
import json, os
prefix = os.environ["OBK_OVERLAY_PATH"]
with open(f"{prefix}/share/task_msgs/msg/Task.json") as file:
    print(json.load(file)["type_hashes"][0]["hash_string"])
"""


@pytest.fixture(scope="module")
def built_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    workspace = make_workspace(tmp_path_factory.mktemp("ws"))
    report = build(workspace)
    assert report["built"] == ["arm_msgs", "other_msgs", "task_msgs"]
    return workspace


@pytest.fixture
def workspace(built_once: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(built_once, tmp_path / "ws", symlinks=True))


def build(workspace: Path, *arguments: str) -> dict[str, list[str]]:
    done = obk(
        "build", "--workspace", workspace, "--format", "json", *arguments, timeout_s=COMPILE_S
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def run(workspace: Path, code: str) -> "subprocess.Popen[str]":
    environment = os.environ | {"OBK_OVERLAY_PATH": str(workspace / ".obk" / "overlay")}
    command = [sys.executable, "-c", code]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)


def output(workspace: Path, code: str) -> str:
    return run(workspace, code).communicate(timeout=60)[0]


def test_two_processes_exchange_a_users_messages_and_service(workspace: Path) -> None:
    subscriber, publisher = run(workspace, SUBSCRIBER), run(workspace, PUBLISHER)
    assert publisher.communicate(timeout=90)[0] == "True\n"
    assert subscriber.communicate(timeout=90)[0] == "walk [1.0, 2.0]\n"


@pytest.mark.slow
def test_only_changed_or_named_packages_and_their_dependents_are_built(workspace: Path) -> None:
    assert build(workspace)["unchanged"] == ["arm_msgs", "other_msgs", "task_msgs"]
    before = output(workspace, TYPE_HASH)
    source = workspace / "src" / "arm_msgs" / "msg" / "Reach.msg"
    source.write_text(source.read_text() + "float64 speed\n")
    word = workspace / "src" / "other_msgs" / "msg" / "Word.msg"
    word.write_text("string words\n")
    assert build(workspace, "arm_msgs")["built"] == ["arm_msgs", "task_msgs"]
    report = build(workspace)
    assert (report["built"], report["unchanged"]) == (["other_msgs"], ["arm_msgs", "task_msgs"])
    after = output(workspace, TYPE_HASH)
    assert before.startswith("RIHS01_")
    assert after.startswith("RIHS01_")
    assert before != after


def test_a_deleted_package_is_removed_from_the_overlay(workspace: Path) -> None:
    shutil.rmtree(workspace / "src" / "other_msgs")
    assert build(workspace)["removed"] == ["other_msgs"]
    overlay = workspace / ".obk" / "overlay"
    assert not [path for path in overlay.parent.rglob("*") if "other_msgs" in path.name]
    assert (overlay / "share" / "task_msgs").is_dir()


def test_an_invalid_definition_leaves_the_overlay_unchanged(workspace: Path) -> None:
    overlay = workspace / ".obk" / "overlay"
    before = overlay.resolve()
    (workspace / "src" / "task_msgs" / "msg" / "Task.msg").write_text("arm_msgs/Raech step\n")
    done = obk("build", "--workspace", workspace)
    assert done.returncode == 1
    assert "msg/Task.msg:1:1: error: " in done.stderr
    assert "did you mean `arm_msgs/Reach`?" in done.stderr
    assert overlay.resolve() == before
    assert [f.name for f in overlay.parent.glob("overlay-*")] == [before.name]


def test_an_interrupt_leaves_the_overlay_unchanged(workspace: Path) -> None:
    overlay = workspace / ".obk" / "overlay"
    before = overlay.resolve()
    command = [OBK, "build", "--clean", "--workspace", workspace]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("generated")
        process.send_signal(signal.SIGINT)
        rest = process.stderr.read()
    assert process.returncode == 130
    assert "interrupted" in rest
    assert overlay.resolve() == before
    assert [f.name for f in overlay.parent.glob("overlay-*")] == [before.name]
    assert build(workspace)["built"] == []


@pytest.mark.slow
def test_two_simultaneous_builds_wait_for_each_other(workspace: Path) -> None:
    (workspace / "src" / "other_msgs" / "msg" / "Word.msg").write_text("string words\n")
    command = [OBK, "build", "--workspace", workspace, "--format", "json"]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    reports = [json.loads(process.communicate(timeout=COMPILE_S)[0]) for process in both]
    assert sorted(report["built"] for report in reports) == [[], ["other_msgs"]]


@pytest.mark.slow
def test_a_launch_builds_stale_packages_and_the_nodes_use_them(workspace: Path) -> None:
    config = make_nodes(workspace)
    source = workspace / "src" / "arm_msgs" / "msg" / "Reach.msg"
    source.write_text(source.read_text() + "float64 speed\n")
    with started(config) as launch:
        launch.wait_for_line("built `arm_msgs`, `task_msgs` in", COMPILE_S)
        launch.wait_for_line("reached 3.0")
    assert launch.process.returncode == 0
    with started(config, "--composed") as launch:
        launch.wait_for_line("reached 3.0")
    assert "built" not in launch.text


@pytest.mark.slow
def test_a_launch_uses_the_messages_of_the_workspace_that_it_is_called_in(
    workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = make_nodes(tmp_path / "other")
    shutil.move(workspace / "src" / "task_msgs", tmp_path / "other" / "src" / "task_msgs")
    monkeypatch.chdir(workspace)
    with started(config) as launch:
        launch.wait_for_line("built `task_msgs`", COMPILE_S)
        launch.wait_for_line("reached 3.0")


@pytest.mark.slow
def test_messages_of_a_running_stacks_workspace_are_shown_from_any_folder(
    workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with started(make_nodes(workspace)) as launch:
        launch.wait_for_line("reached 3.0")
        monkeypatch.chdir(tmp_path)
        words = ("topic", "echo", "est", "steps[0].joints", "--once")
        shown = obk(*words)
    assert (shown.stdout, shown.returncode) == ("[1.0, 2.0]\n", 0), shown.stderr


@pytest.mark.slow
def test_a_launch_without_building_reports_stale_packages(workspace: Path) -> None:
    config = make_nodes(workspace)
    (workspace / "src" / "other_msgs" / "msg" / "Word.msg").write_text("string words\n")
    with started(config, "--no-build") as launch:
        launch.wait_for_line("warning: `other_msgs`: changed since compiled (not built because of")
        launch.wait_for_line("reached 3.0")


def test_a_launch_that_is_interrupted_while_it_builds_starts_nothing(workspace: Path) -> None:
    config = make_nodes(workspace)
    (workspace / "src" / "arm_msgs" / "msg" / "Reach.msg").write_text("float64[] joints\n")
    with started(config) as launch:
        launch.wait_for_line("generated")
        launch.process.send_signal(signal.SIGINT)
        assert launch.process.wait(60) == 130
    assert launch.lines[-1].startswith("error: interrupted")
    assert "starting" not in launch.text


def test_a_launch_does_not_start_with_an_invalid_definition(workspace: Path) -> None:
    config = make_nodes(workspace)
    (workspace / "src" / "other_msgs" / "msg" / "Word.msg").write_text("uint8 a 256\n")
    done = obk("launch", config)
    assert done.returncode == 1
    assert "msg/Word.msg:1:9: error: " in done.stderr
    assert "starting" not in done.stdout


def test_the_packages_that_are_installed_are_not_built_again(repository: Path) -> None:
    before = (repository / ".obk").exists()
    report = build(repository)
    assert report["built"] == []
    assert "obelisk_control_msgs" in report["installed"]
    assert (repository / ".obk").exists() == before
