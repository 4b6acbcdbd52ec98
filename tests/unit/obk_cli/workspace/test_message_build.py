"""A workspace with a sourced ROS 2, and a fake colcon that records its arguments."""

import json
import os
from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.workspace.message_build import (
    BuildCallbacks,
    BuildOptions,
    build_workspace,
    find_colcon,
)
from obk_cli.workspace.overlay import underlays_of, with_overlays

MANIFEST = "<package format='3'><name>{}</name><version>0.1.0</version></package>"
COLCON = """#!/bin/sh
printf '%s\\n' "$PWD" "$@" > "$NOTES"
for package in my_msgs node; do mkdir -p install/$package/share/$package; done
exit $EXIT_CODE
"""


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    folder = tmp_path / "ws" / "src"
    for name in ("my_msgs", "node"):
        (folder / name).mkdir(parents=True)
        (folder / name / "package.xml").write_text(MANIFEST.format(name))
    (folder / "my_msgs" / "msg").mkdir()
    (folder / "my_msgs" / "msg" / "A.msg").write_text("float64 a\n")
    return folder.parent


@pytest.fixture
def sourced(tmp_path: Path) -> dict[str, str]:
    ros, programs = tmp_path / "ros", tmp_path / "bin"
    (ros / "lib").mkdir(parents=True)
    (ros / "lib" / "librcl.so").touch()
    programs.mkdir()
    (programs / "colcon").write_text(COLCON)
    (programs / "colcon").chmod(0o755)
    return {
        "PATH": f"{programs}:{os.environ['PATH']}",
        "AMENT_PREFIX_PATH": str(ros),
        "NOTES": str(tmp_path / "notes"),
        "EXIT_CODE": "0",
    }


def asked(environment: dict[str, str]) -> list[str]:
    return Path(environment["NOTES"]).read_text().splitlines()


def test_colcon_builds_with_a_sourced_ros_and_is_reported(
    workspace: Path, sourced: dict[str, str]
) -> None:
    notes: list[str] = []
    listener = BuildCallbacks(on_note=notes.append)
    built = build_workspace(workspace, BuildOptions(environment=sourced), listener)
    select = ["build", "--packages-select", "my_msgs", "node"]
    assert asked(sourced) == [str(workspace), *select]
    assert notes == [f"building with the sourced ROS 2: {find_colcon(sourced)} {' '.join(select)}"]
    assert (built.builder, built.built) == ("colcon", ("my_msgs", "node"))
    assert built.prefixes == (workspace / "install" / "my_msgs",)
    record = json.loads((built.overlay / "overlay.json").read_text())
    assert (record["builder"], list(record["packages"])) == ("colcon", ["my_msgs"])


def test_a_definition_that_only_cmake_names_is_reported(
    workspace: Path, sourced: dict[str, str]
) -> None:
    notes: list[str] = []
    (package,) = workspace.rglob("*.msg")
    cmake = package.parents[1] / "CMakeLists.txt"
    cmake.write_text(
        "rosidl_generate_interfaces(${PROJECT_NAME}\n"
        f'  "msg/{package.name}"  # "msg/Old.msg"\n'
        '  "msg/Gone.msg" "msg/${WHICH}Kind.msg" "${WHERE}/msg/Far.msg"\n'
        "  DEPENDENCIES std_msgs)\n"
    )
    build_workspace(
        workspace, BuildOptions(environment=sourced), BuildCallbacks(on_note=notes.append)
    )
    found = [note for note in notes if str(cmake) in note]
    assert len(found) == 1
    assert "`msg/Gone.msg`" in found[0]


def test_for_a_launch_colcon_builds_stale_messages_only(
    workspace: Path, sourced: dict[str, str]
) -> None:
    options = BuildOptions(environment=sourced, only_messages=True)
    assert build_workspace(workspace, options).built == ("my_msgs",)
    assert asked(sourced)[-1:] == ["my_msgs"]
    Path(sourced["NOTES"]).unlink()
    assert build_workspace(workspace, options).built == ()
    assert not Path(sourced["NOTES"]).exists()


def test_packages_that_colcon_does_not_build_leave_the_overlay_unchanged(
    workspace: Path, sourced: dict[str, str]
) -> None:
    options = BuildOptions(environment={**sourced, "EXIT_CODE": "3"})
    with pytest.raises(CommandFailedError, match="failed with exit code 3"):
        build_workspace(workspace, options)
    assert not (workspace / ".obk" / "overlay").exists()


def test_without_a_sourced_ros_or_without_colcon_obk_builds(sourced: dict[str, str]) -> None:
    assert find_colcon(sourced) is not None
    assert find_colcon({**sourced, "AMENT_PREFIX_PATH": ""}) is None
    assert find_colcon({**sourced, "PATH": "/nowhere"}) is None


def test_overlays_precede_everything_else(tmp_path: Path) -> None:
    overlay = tmp_path / "overlay"
    given = {"AMENT_PREFIX_PATH": "/ros", "LD_LIBRARY_PATH": f"/ros/lib:{overlay}/lib", "A": "b"}
    merged = with_overlays(given, [overlay])
    assert merged["AMENT_PREFIX_PATH"] == f"{overlay}:/ros"
    assert merged["LD_LIBRARY_PATH"] == f"{overlay}/lib:/ros/lib"
    assert merged["OBK_OVERLAY_PATH"] == str(overlay)
    assert merged["A"] == "b"
    assert with_overlays(given, []) == given
    assert underlays_of(merged, [overlay])[0] == Path("/ros")
