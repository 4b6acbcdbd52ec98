import ast
import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest


@pytest.fixture
def preflight(repository: Path) -> ModuleType:
    path = repository / "tools" / "preflight.py"
    spec = importlib.util.spec_from_file_location("preflight", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_old_python_can_read_it(repository: Path) -> None:
    ast.parse((repository / "tools" / "preflight.py").read_text(), feature_version=(3, 4))


@pytest.mark.parametrize("version", [(3, 11), (3, 12), (3, 13)])
def test_the_supported_pythons_pass(
    preflight: ModuleType, monkeypatch: pytest.MonkeyPatch, version: tuple[int, int]
) -> None:
    monkeypatch.setattr(sys, "version_info", (*version, 0))
    assert preflight.version_fault() == ""


@pytest.mark.parametrize("version", [(3, 8), (3, 10), (3, 14)])
def test_another_python_is_rejected_with_a_hint_how_to_choose_one(
    preflight: ModuleType, monkeypatch: pytest.MonkeyPatch, version: tuple[int, int]
) -> None:
    monkeypatch.setattr(sys, "version_info", (*version, 0))
    monkeypatch.setattr(sys, "executable", "/usr/bin/python3")
    assert preflight.version_fault() == (
        f"/usr/bin/python3 is Python {version[0]}.{version[1]}: Obelisk needs 3.11, 3.12 or 3.13. "
        "Choose another one with: make setup PYTHON=/path/to/python3"
    )


def test_a_machine_without_wheels_gets_a_hint_to_source_ros(
    preflight: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "uname", lambda: SimpleNamespace(machine="aarch64"))
    assert preflight.ros_fault("wheels") == (
        "no ROS 2 wheels exist for aarch64: install ROS 2 Jazzy, source it, "
        "and run: make setup ROS=system"
    )


def test_the_system_ros_must_be_sourced(
    preflight: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    assert preflight.ros_fault("system").startswith("ROS=system, but no ROS 2 is sourced")


def test_the_system_ros_must_match_the_python(
    preflight: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/opt/ros/jazzy")
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert "cannot import rclpy: use the Python that" in preflight.ros_fault("system")


def test_an_unknown_source_of_ros_is_rejected_with_the_valid_ones(preflight: ModuleType) -> None:
    assert preflight.ros_fault("docker") == (
        "unknown value ROS=docker: use ROS=wheels (the default) or ROS=system"
    )
