"""The message build on a user's package: compiled, used by rclpy, skipped when unchanged."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from obk_interfaces import (
    DefinitionError,
    DependencyError,
    Progress,
    build,
    discover,
)

from .workspace import write_files

UNDERLAYS = [Path(sys.prefix)]
MANIFEST = """<package format="3"><name>user_msgs</name><version>1.2.3</version>
<depend>obelisk_control_msgs</depend><depend>builtin_interfaces</depend>{extra}</package>"""
DEFINITIONS = {
    "msg/Plan.msg": (
        "uint8 FAST=2\nstring<=8 label\nfloat64 speed 1.5\nwstring note\n"
        "obelisk_control_msgs/PositionSetpoint[<=2] steps\nbuiltin_interfaces/Duration length\n"
    ),
    "srv/Ask.srv": "int32 a\n---\nint32 twice\n",
    "action/Walk.action": "float64 distance\n---\nbool done\n---\nfloat64 walked\n",
}
USE = """
import rclpy
from user_msgs.action import Walk
from user_msgs.msg import Plan
from user_msgs.srv import Ask

rclpy.init()
node = rclpy.create_node("user")
plans = []
subscription = node.create_subscription(Plan, "plan", plans.append, 1)
publisher = node.create_publisher(Plan, "plan", 1)
def answer(request, response):
    response.twice = 2 * request.a
    return response
service = node.create_service(Ask, "ask", answer)
client = node.create_client(Ask, "ask")
assert client.wait_for_service(timeout_sec=30)
future = client.call_async(Ask.Request(a=21))
rclpy.spin_until_future_complete(node, future, timeout_sec=30)
for _ in range(300):
    publisher.publish(Plan(label="x", note="y"))
    rclpy.spin_once(node, timeout_sec=0.1)
    if plans:
        break
print(future.result().twice, plans[0].label, plans[0].speed, Plan.FAST, Walk.Goal().distance)
rclpy.shutdown()
"""


@pytest.fixture
def source(tmp_path: Path) -> Path:
    source = tmp_path / "source"
    for name, text in DEFINITIONS.items():
        (source / name).parent.mkdir(parents=True)
        (source / name).write_text(text)
    (source / "package.xml").write_text(MANIFEST.format(extra=""))
    return source


@pytest.mark.ros
def test_a_package_is_built_once_and_used_from_an_overlay(source: Path, tmp_path: Path) -> None:
    overlay, build_dir, steps = tmp_path / "overlay", tmp_path / "build", list[Progress]()

    report = build(
        discover([source]),
        build_dir=build_dir,
        prefix=overlay,
        underlays=UNDERLAYS,
        on_progress=steps.append,
    )
    assert report.built == ("user_msgs",)
    assert {step.step for step in steps} == {"generate", "compile", "link", "install"}
    assert all(1 <= step.done <= step.total for step in steps)
    assert files_that_name(tmp_path, overlay) == []

    environment = os.environ | {"OBK_OVERLAY_PATH": str(overlay)}
    user = [sys.executable, "-c", USE]
    output = subprocess.run(
        user, env=environment, stdout=subprocess.PIPE, text=True, check=True, timeout=120
    ).stdout
    assert output == "42 x 1.5 2 0.0\n"

    again = build(discover([source]), build_dir=build_dir, prefix=overlay, underlays=UNDERLAYS)
    assert (again.built, again.unchanged) == ((), ("user_msgs",))


@pytest.mark.ros
def test_an_unchanged_package_is_installed_into_a_new_prefix(source: Path, tmp_path: Path) -> None:
    (source / "srv" / "Ask.srv").unlink()
    (source / "action" / "Walk.action").unlink()
    packages = discover([source])
    build(packages, build_dir=tmp_path / "b", prefix=tmp_path / "one", underlays=UNDERLAYS)
    report = build(packages, build_dir=tmp_path / "b", prefix=tmp_path / "two", underlays=UNDERLAYS)
    assert report.unchanged == ("user_msgs",)
    assert files_in(tmp_path / "two") == files_in(tmp_path / "one") != []


@pytest.mark.ros
def test_an_invalid_default_is_reported_with_its_location_and_installs_nothing(
    source: Path, tmp_path: Path
) -> None:
    (source / "msg" / "Plan.msg").write_text("uint8 small 256\n")
    with pytest.raises(DefinitionError, match=r"msg/Plan\.msg:1:13: .*255"):
        build(
            discover([source]),
            build_dir=tmp_path / "b",
            prefix=tmp_path / "overlay",
            underlays=UNDERLAYS,
        )
    assert not (tmp_path / "overlay").exists()


@pytest.mark.ros
def test_invalid_definitions_are_rejected_before_anything_is_generated(
    source: Path, tmp_path: Path
) -> None:
    (source / "msg" / "Plan.msg").write_text("int32 short\n")
    with pytest.raises(DefinitionError, match=r"msg/Plan\.msg:1:7: `short`"):
        build(
            discover([source]),
            build_dir=tmp_path / "b",
            prefix=tmp_path / "overlay",
            underlays=UNDERLAYS,
        )
    assert not (tmp_path / "b").exists()


@pytest.mark.ros
def test_a_dependency_that_is_nowhere_is_named(source: Path, tmp_path: Path) -> None:
    (source / "package.xml").write_text(MANIFEST.format(extra="<depend>far_msgs</depend>"))
    with pytest.raises(DependencyError, match=r"user_msgs .*far_msgs"):
        build(
            discover([source]),
            build_dir=tmp_path / "b",
            prefix=tmp_path / "overlay",
            underlays=UNDERLAYS,
        )


def files_in(prefix: Path) -> list[str]:
    return sorted(str(f.relative_to(prefix)) for f in prefix.rglob("*") if f.is_file())


def files_that_name(folder: Path, prefix: Path) -> list[Path]:
    needle = str(folder).encode()
    return [f for f in prefix.rglob("*") if f.is_file() and needle in f.read_bytes()]


@pytest.mark.ros
def test_dependencies_of_cmake_alone_are_followed_through_packages(tmp_path: Path) -> None:
    write_files(
        tmp_path / "src",
        {
            "near_msgs/package.xml": MANIFEST.format(extra="").replace("user_msgs", "near_msgs"),
            "near_msgs/CMakeLists.txt": "find_package(geometry_msgs REQUIRED)\n",
            "near_msgs/msg/Near.msg": "geometry_msgs/Point at\n",
            "far_msgs/package.xml": MANIFEST.format(extra="").replace("user_msgs", "far_msgs"),
            "far_msgs/CMakeLists.txt": "rosidl_generate_interfaces(x m DEPENDENCIES near_msgs)\n",
            "far_msgs/msg/Far.msg": "std_msgs/Header header\nnear_msgs/Near[] all\n",
        },
    )
    report = build(
        discover([tmp_path / "src"]),
        build_dir=tmp_path / "b",
        prefix=tmp_path / "overlay",
        underlays=UNDERLAYS,
    )
    assert report.built == ("near_msgs", "far_msgs")
