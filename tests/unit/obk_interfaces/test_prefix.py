"""The locations of installed packages and their headers."""

import importlib.util
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

from obk_interfaces import Interface, InterfacePackage, NoRosError
from obk_interfaces.prefix import Prefixes, find_ros_prefix, include_folders


def test_missing_generators_mean_that_there_is_no_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(NoRosError):
        find_ros_prefix()


def test_the_ros_prefix_is_found_from_the_generators(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    origin = (
        tmp_path / "lib" / "python3.12" / "site-packages" / "rosidl_generator_c" / "__init__.py"
    )
    (tmp_path / "share" / "rosidl_generator_c" / "resource").mkdir(parents=True)
    spec = ModuleSpec("rosidl_generator_c", None, origin=str(origin))
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: spec)
    assert find_ros_prefix() == tmp_path


def install(prefix: Path, name: str, *depends: str, kind: str = "msg") -> Path:
    share = prefix / "share" / name
    (share / kind).mkdir(parents=True)
    tags = "".join(f"<depend>{depend}</depend>" for depend in depends)
    (share / "package.xml").write_text(f"<package><name>{name}</name>{tags}</package>")
    return share


def test_dependencies_are_followed_through_the_layers_nearest_first(tmp_path: Path) -> None:
    overlay, ros = tmp_path / "overlay", tmp_path / "ros"
    near = install(overlay, "b_msgs", "c_msgs")
    install(ros, "b_msgs")
    far = install(ros, "c_msgs", "ament_cmake")
    install(ros, "ament_cmake", kind="cmake")
    service = install(ros, "service_msgs")
    package = InterfacePackage(
        root=tmp_path,
        name="a_msgs",
        version="1.0.0",
        depends=("b_msgs", "missing"),
        interfaces=(Interface(kind="srv", name="Go"),),
    )
    closure = Prefixes(layers=(overlay,), ros=ros).closure(package)
    assert closure == {"b_msgs": near, "service_msgs": service, "c_msgs": far}


def test_headers_are_searched_next_to_and_inside_package_folders(tmp_path: Path) -> None:
    include = tmp_path / "include"
    (include / "std_msgs" / "std_msgs").mkdir(parents=True)
    (include / "flat").mkdir()
    assert include_folders([tmp_path, tmp_path / "none"]) == (include, include / "std_msgs")
