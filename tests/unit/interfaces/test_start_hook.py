"""The start hook of the interpreter, in fake environments of empty files."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SITE = Path("lib", f"python{sys.version_info[0]}.{sys.version_info[1]}", "site-packages")
REPORT = """
import json, os, sys
sys.path.insert(0, {site!r})
import obk_ros_env
obk_ros_env.activate()
names = "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "PYTHONPATH"
print(json.dumps([os.getpid(), sys.path, *(os.environ.get(n, "").split(":") for n in names)]))
"""


@pytest.fixture
def prefix(tmp_path: Path, repository: Path) -> Path:
    """An environment with only the start hook."""
    prefix = tmp_path / "env"
    (prefix / SITE).mkdir(parents=True)
    shutil.copy(repository / "interfaces" / "obk_ros_env.py", prefix / SITE)
    return prefix


@pytest.fixture
def sourced(tmp_path: Path) -> Path:
    """A ROS 2 that a shell may have sourced."""
    sourced = tmp_path / "opt"
    (sourced / SITE / "rclpy").mkdir(parents=True)
    (sourced / "lib" / "librcl.so").touch()
    return sourced


def start(prefix: Path, **variables: str) -> tuple[list[str], ...]:
    """Start Python with the hook; return sys.path and the three variables as lists."""
    kept = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    command = [sys.executable, "-S", "-c", REPORT.format(site=str(prefix / SITE))]
    with subprocess.Popen(command, env=kept | variables, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        pid, *lists = json.load(process.stdout)
    assert process.returncode == 0
    assert pid == process.pid, "the interpreter must keep its process"
    return tuple(lists)


def test_wheels_come_first_on_the_library_path_in_a_fixed_order(prefix: Path) -> None:
    (prefix / "lib" / "librcl.so").touch()
    for letter in "dbeac":
        (prefix / SITE / f"ros_{letter}.libs").mkdir()
    (prefix / SITE / "other.libs").mkdir()
    _, ament, libraries, _ = start(prefix, LD_LIBRARY_PATH="/mine")
    assert ament == [str(prefix)]
    assert libraries == [
        f"{prefix}/lib",
        *(f"{prefix / SITE}/ros_{letter}.libs" for letter in "abcde"),
        "/mine",
    ]


def test_wheels_keep_a_sourced_ros_out_and_the_rest_of_the_shell_in(
    prefix: Path, sourced: Path
) -> None:
    (prefix / "lib" / "librcl.so").touch()
    _, ament, libraries, python = start(
        prefix,
        AMENT_PREFIX_PATH=f"/workspace:{sourced}",
        LD_LIBRARY_PATH=f"{sourced}/lib:/elsewhere/ros_fastrtps.libs:/mine",
        PYTHONPATH=f"{sourced / SITE}:/mine/python",
    )
    assert ament == [str(prefix), "/workspace"]
    assert libraries == [f"{prefix}/lib", "/mine"]
    assert python == ["/mine/python"]


def test_a_sourced_ros_is_kept_if_there_are_no_wheels(prefix: Path, sourced: Path) -> None:
    _, ament, libraries, python = start(
        prefix,
        AMENT_PREFIX_PATH=str(sourced),
        LD_LIBRARY_PATH=f"{sourced}/lib",
        PYTHONPATH=str(sourced / SITE),
    )
    assert ament == [str(prefix), str(sourced)]
    assert libraries == [f"{sourced}/lib"]
    assert python == [str(sourced / SITE)]


@pytest.mark.parametrize("wheels", [True, False])
def test_overlays_are_in_front_of_the_environment(
    prefix: Path, tmp_path: Path, wheels: bool
) -> None:
    if wheels:
        (prefix / "lib" / "librcl.so").touch()
    near, own = tmp_path / "near", prefix / "overlay"
    for overlay in (near, own):
        (overlay / SITE).mkdir(parents=True)
    path, ament, libraries, _ = start(prefix, OBK_OVERLAY_PATH=str(near))
    assert ament == [str(near), str(own), str(prefix)]
    assert libraries == [f"{near}/lib", f"{own}/lib", f"{prefix}/lib"]
    assert path[:2] == [str(near / SITE), str(own / SITE)]
