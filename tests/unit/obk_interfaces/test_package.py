from itertools import pairwise
from pathlib import Path

import pytest

from obk_interfaces import DependencyError, Interface, PackageError, discover


def write_package(
    root: Path, name: str, *depends: str, files: tuple[str, ...] = ("msg/A.msg",)
) -> Path:
    folder = root / name
    tags = "".join(f"<depend>{depend}</depend>" for depend in depends)
    for file in files:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text("float64 x\n")
    text = f"<package><name>{name}</name><version>1.0.0</version>{tags}</package>"
    (folder / "package.xml").write_text(text)
    return folder


def test_packages_come_after_those_they_depend_on(tmp_path: Path) -> None:
    write_package(tmp_path, "a_msgs", "c_msgs", "std_msgs")
    write_package(tmp_path, "b_msgs")
    write_package(tmp_path, "c_msgs", "b_msgs")
    assert [p.name for p in discover([tmp_path])] == ["b_msgs", "c_msgs", "a_msgs"]


@pytest.mark.parametrize(
    ("cmake", "depends"),
    [
        ("find_package(b_msgs REQUIRED)", ("b_msgs",)),
        ("find_package(unused_msgs REQUIRED)", ()),
        ("# find_package(b_msgs)\n#[[ find_package(b_msgs) ]]", ()),
        (
            'rosidl_generate_interfaces(${PROJECT_NAME}\n  "msg/A.msg"  # the only one\n'
            "  DEPENDENCIES c_msgs d_msgs\n  ADD_LINTER_TESTS)",
            ("c_msgs", "d_msgs"),
        ),
        (
            'set(needed c_msgs "d_msgs")\n'
            "rosidl_generate_interfaces(x DEPENDENCIES ${needed} LIBRARY_NAME other)",
            ("c_msgs", "d_msgs"),
        ),
        ("rosidl_generate_interfaces(x DEPENDENCIES", ()),
    ],
)
def test_dependencies_are_read_from_cmake_too(
    tmp_path: Path, cmake: str, depends: tuple[str, ...]
) -> None:
    folder = write_package(tmp_path, "a_msgs")
    (folder / "msg/A.msg").write_text("b_msgs/Thing thing\n")
    (folder / "CMakeLists.txt").write_text(cmake)
    (package,) = discover([tmp_path])
    assert package.depends == depends


def test_a_standard_package_that_is_used_needs_no_declaration(tmp_path: Path) -> None:
    folder = write_package(tmp_path, "a_msgs")
    (folder / "msg/A.msg").write_text(
        "std_msgs/Header header\n  geometry_msgs/msg/Point p\n# nav_msgs/Path\nfar_msgs/Far x\n"
    )
    (package,) = discover([tmp_path])
    assert package.depends == ("geometry_msgs", "std_msgs")


def test_a_dependency_cycle_is_reported_with_its_members(tmp_path: Path) -> None:
    write_package(tmp_path, "a_msgs", "b_msgs")
    write_package(tmp_path, "b_msgs", "c_msgs")
    write_package(tmp_path, "c_msgs", "b_msgs")
    with pytest.raises(DependencyError) as caught:
        discover([tmp_path])
    assert str(caught.value).endswith(": b_msgs -> c_msgs -> b_msgs")


def test_all_kinds_of_definitions_are_found(tmp_path: Path) -> None:
    write_package(tmp_path, "a_msgs", files=("srv/Go.srv", "msg/Pose.msg", "action/Walk.action"))
    (package,) = discover([tmp_path])
    assert [i.file for i in package.interfaces] == [
        "action/Walk.action",
        "msg/Pose.msg",
        "srv/Go.srv",
    ]
    assert package.kinds == ("msg", "srv", "action")


def test_an_ignored_folder_is_skipped(tmp_path: Path) -> None:
    write_package(tmp_path, "a_msgs")
    (write_package(tmp_path, "b_msgs") / "COLCON_IGNORE").touch()
    assert [p.name for p in discover([tmp_path])] == ["a_msgs"]


def test_the_same_folder_given_twice_is_one_package(tmp_path: Path) -> None:
    write_package(tmp_path, "a_msgs")
    assert len(discover([tmp_path, tmp_path / "a_msgs"])) == 1


def test_two_packages_of_one_name_are_rejected(tmp_path: Path) -> None:
    first = write_package(tmp_path / "one", "a_msgs")
    second = write_package(tmp_path / "two", "a_msgs")
    with pytest.raises(PackageError, match="a_msgs") as caught:
        discover([tmp_path])
    assert str(first) in str(caught.value)
    assert str(second) in str(caught.value)


def test_a_folder_without_packages_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(PackageError, match=r"package\.xml and msg/"):
        discover([tmp_path])


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(PackageError) as caught:
        discover([tmp_path / "none"])
    assert str(caught.value).endswith(str(tmp_path / "none"))


def test_broken_xml_is_reported_with_its_location(tmp_path: Path) -> None:
    manifest = write_package(tmp_path, "a_msgs") / "package.xml"
    manifest.write_text("<package>\n  <name>a_msgs</nam>\n</package>")
    with pytest.raises(PackageError) as caught:
        discover([tmp_path])
    assert str(caught.value).startswith(f"{manifest}:2:17: ")


def growing(times: int) -> str:
    """Entities that each contain several of the previous one; the last one is called `e`."""
    lines = [f'<!ENTITY {name} "{f"&{before};" * times}">' for before, name in pairwise("abcde")]
    return "".join(['<!ENTITY a "haha">', *lines])


@pytest.mark.parametrize(
    "entities",
    ['<!ENTITY e SYSTEM "secret">', growing(times=100)],
    ids=["a file of the host", "a text that grows without bound"],
)
def test_xml_entities_are_not_expanded(tmp_path: Path, entities: str) -> None:
    folder = write_package(tmp_path, "a_msgs")
    (folder / "secret").write_text("a secret")
    text = f"<!DOCTYPE package [{entities}]><package><name>&e;</name></package>"
    (folder / "package.xml").write_text(text)
    with pytest.raises(PackageError, match="XML") as caught:
        discover([tmp_path])
    assert "a secret" not in str(caught.value)


def test_a_manifest_without_a_version_is_rejected(tmp_path: Path) -> None:
    manifest = write_package(tmp_path, "a_msgs") / "package.xml"
    manifest.write_text("<package><name>a_msgs</name></package>")
    with pytest.raises(PackageError) as caught:
        discover([tmp_path])
    assert str(caught.value).startswith(f"{manifest}: ")
    assert "<version>" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "stem"),
    [
        ("ObkImu", "obk_imu"),
        ("PDFeedForward", "pd_feed_forward"),
        ("ExecutionFSM", "execution_fsm"),
    ],
)
def test_generated_sources_are_named_as_rosidl_names_them(name: str, stem: str) -> None:
    assert Interface(kind="msg", name=name).stem == stem


@pytest.mark.parametrize("encoding", ["gbk", "utf-32", "no-such-thing"])
def test_a_manifest_in_an_unknown_encoding_is_reported(tmp_path: Path, encoding: str) -> None:
    folder = write_package(tmp_path, "a_msgs")
    manifest = folder / "package.xml"
    manifest.write_text(f'<?xml version="1.0" encoding="{encoding}"?>\n{manifest.read_text()}')
    with pytest.raises(PackageError, match=r"package\.xml:1:1: .*use UTF-8$"):
        discover([tmp_path])


def test_hidden_files_next_to_a_definition_are_ignored(tmp_path: Path) -> None:
    folder = write_package(tmp_path, "a_msgs")
    (folder / "msg/.#A.msg").symlink_to("me@host.1234")
    (folder / "msg/.B.msg").write_text("half of it")
    (package,) = discover([tmp_path])
    assert [i.file for i in package.interfaces] == ["msg/A.msg"]


def test_a_definition_that_is_a_folder_is_reported(tmp_path: Path) -> None:
    (write_package(tmp_path, "a_msgs") / "msg/B.msg").mkdir()
    with pytest.raises(PackageError, match=r"msg/B\.msg: "):
        discover([tmp_path])
