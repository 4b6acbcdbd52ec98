"""Generated packages, checked by other programs: ruff, and pytest with ROS."""

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath

import pytest

from obk_cli.scaffold.kinds import LONGEST_NAME
from obk_cli.scaffold.templates import RenderedFile
from obk_cli.scaffold.write import decide, write_decisions

Package = Callable[..., dict[PurePosixPath, RenderedFile]]

REPOSITORY = Path(__file__).parents[4]
LONG = "a_controller_" + "x" * (LONGEST_NAME - 13)
VARIANTS = [
    ("controller", "foo", {}),
    ("controller", LONG, {"ctrl_msg": "PDFeedForward"}),
    ("controller", "foo", {"ctrl_msg": "VelocityCommand", "est_msg": "nav_msgs/Odometry"}),
    ("controller", "foo", {"ctrl_msg": "my_msgs/Thrust", "est_msg": "a_msgs/MultiDofStateVector"}),
    ("controller", "z9", {"ctrl_msg": "std_msgs/Int16", "est_msg": "std_msgs/Int8"}),
    ("estimator", "foo", {}),
    ("estimator", LONG, {"sensor_msg": "ObkJointEncoders"}),
    ("estimator", "zoo_estimator", {"sensor_msg": "sensor_msgs/Imu", "est_msg": "a_msgs/IMU"}),
    ("estimator", "foo", {"sensor_msg": "a_msgs/Gyro", "est_msg": "a_msgs/IMU"}),
    ("robot", "foo", {}),
    ("robot", LONG, {"ctrl_msg": "VelocityCommand", "sensor_msg": "ObkJointEncoders"}),
    ("robot", "foo", {"ctrl_msg": "a_msgs/Thrust", "sensor_msg": "ObkImu"}),
    ("sensor", "foo", {}),
    ("sensor", LONG, {"sensor_msg": "ObkFramePose"}),
    ("sensor", "foo", {"sensor_msg": "sensor_msgs/Image"}),
]


def write(files: Mapping[PurePosixPath, RenderedFile], root: Path) -> Path:
    write_decisions(root, decide(files.values(), {}))
    return root


def call(
    *arguments: str, cwd: Path, env: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", *arguments],
        cwd=cwd,
        env=env,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def run(*arguments: str, cwd: Path, env: Mapping[str, str] | None = None) -> None:
    done = call(*arguments, cwd=cwd, env=env)
    assert done.returncode == 0, done.stdout + done.stderr


def ros_environment(tmp_path: Path) -> dict[str, str]:
    return os.environ | {
        "ROS_LOG_DIR": str(tmp_path / "log"),
        "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
    }


def test_they_pass_ruff_with_their_rules_and_the_projects(package: Package, tmp_path: Path) -> None:
    roots = [
        write(package(kind, name, **typed), tmp_path / f"{number}_{kind}" / name)
        for number, (kind, name, typed) in enumerate(VARIANTS)
    ]
    run("ruff", "check", "--no-cache", ".", cwd=tmp_path)
    run("ruff", "format", "--no-cache", "--check", ".", cwd=tmp_path)
    rules = ("--config", str(REPOSITORY / "pyproject.toml"))
    sources = ("--config", f"src = {[str(root) for root in roots]}")
    run("ruff", "check", "--no-cache", *rules, *sources, ".", cwd=tmp_path)


@pytest.mark.slow
def test_they_pass_mypy_with_their_rules(
    package: Package, tmp_path: Path, mypy_cache: Path
) -> None:
    roots = []
    for kind in ("controller", "estimator", "robot", "sensor"):
        name = f"foo_{kind}"
        root = write(package(kind, name), tmp_path / name)
        with (root / name / f"{name}.py").open("a") as node:
            node.write(f"\n\ndef report(node: Foo{kind.capitalize()}) -> None:\n")
            node.write("    node.get_logger().info('here')\n")
        roots.append(root)
    # The rules of a package contain its name, and are otherwise the same.
    rules = {(root / "pyproject.toml").read_text().replace(root.name, "foo") for root in roots}
    assert len(rules) == 1
    packages = [word for root in roots for word in ("--package", root.name)]
    run(
        *("mypy", "--cache-dir", str(mypy_cache), *packages),
        cwd=roots[0],
        env=os.environ | {"MYPYPATH": os.pathsep.join(map(str, roots))},
    )


@pytest.mark.ros
@pytest.mark.parametrize(
    ("kind", "typed"),
    [
        ("controller", {}),
        pytest.param("controller", {"ctrl_msg": "PDFeedForward"}, marks=pytest.mark.slow),
        pytest.param("controller", {"ctrl_msg": "VelocityCommand"}, marks=pytest.mark.slow),
        pytest.param(
            "controller",
            {"ctrl_msg": "TwistStamped", "est_msg": "nav_msgs/Odometry"},
            marks=pytest.mark.slow,
        ),
        pytest.param("estimator", {}, marks=pytest.mark.slow),
        pytest.param("estimator", {"sensor_msg": "ObkJointEncoders"}, marks=pytest.mark.slow),
        pytest.param(
            "estimator",
            {"sensor_msg": "ObkImage", "est_msg": "sensor_msgs/JointState"},
            marks=pytest.mark.slow,
        ),
        pytest.param("robot", {}, marks=pytest.mark.slow),
        pytest.param(
            "robot",
            {"ctrl_msg": "PDFeedForward", "sensor_msg": "ObkJointEncoders"},
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "robot",
            {"ctrl_msg": "VelocityCommand", "sensor_msg": "ObkFramePose"},
            marks=pytest.mark.slow,
        ),
        pytest.param("sensor", {}, marks=pytest.mark.slow),
        ("sensor", {"sensor_msg": "ObkImu"}),
        pytest.param("sensor", {"sensor_msg": "ObkJointEncoders"}, marks=pytest.mark.slow),
        pytest.param("sensor", {"sensor_msg": "LaserScan"}, marks=pytest.mark.slow),
    ],
)
def test_its_own_test_passes(
    package: Package, tmp_path: Path, kind: str, typed: dict[str, str]
) -> None:
    root = write(package(kind, "foo", **typed), tmp_path / "foo")
    run("pytest", "-q", "-p", "no:cacheprovider", cwd=root, env=ros_environment(tmp_path))


@pytest.mark.ros
@pytest.mark.parametrize(
    ("file", "right", "wrong", "reason"),
    [
        (
            "foo/foo.py",
            "return super().on_configure(state)",
            'super().on_configure(state)\n        raise ValueError("the gains are missing")',
            "/obelisk_control_0 did not configure: on_configure: ValueError: the gains are missing",
        ),
        (
            "test/foo.yaml",
            "timer_period_sec: 0.001",
            "timer_period_sec: fast",
            "foo.yaml:",
        ),
    ],
)
def test_a_failed_transition_shows_the_reason_of_the_node(
    package: Package, tmp_path: Path, file: str, right: str, wrong: str, reason: str
) -> None:
    root = write(package("controller", "foo"), tmp_path / "foo")
    text = (root / file).read_text()
    assert text.count(right) == 1
    (root / file).write_text(text.replace(right, wrong))
    done = call("pytest", "-q", "-p", "no:cacheprovider", cwd=root, env=ros_environment(tmp_path))
    assert done.returncode == 1
    assert reason in done.stdout
