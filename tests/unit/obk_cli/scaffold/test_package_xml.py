from obk_cli.scaffold.package_files import PackageIdentity, add_dependencies, read_identity

MANIFEST = """<?xml version="1.0" encoding="utf-8"?>
<package format="3">
  <name>foo</name>
  <!-- needed -->
  <depend>std_msgs</depend>
  <exec_depend version_gte="1">rclpy</exec_depend>  <!-- why -->
  <export><build_type>ament_python</build_type></export>
</package>
"""


def test_the_name_and_build_type_are_read() -> None:
    assert read_identity(MANIFEST) == PackageIdentity(name="foo", build_type="ament_python")


def test_without_a_build_type_it_is_catkin() -> None:
    assert read_identity("<package><name>foo</name></package>") == PackageIdentity(
        name="foo", build_type="catkin"
    )


def test_an_invalid_manifest_is_reported_separately() -> None:
    assert read_identity("<package/>") is None
    assert read_identity("name: foo") is None


def test_missing_dependencies_are_added_after_existing_ones() -> None:
    changed = add_dependencies(MANIFEST, ["std_msgs", "rclpy", "b_msgs", "a_msgs"])
    assert changed == MANIFEST.replace(
        "rclpy</exec_depend>",
        "rclpy</exec_depend>\n  <exec_depend>a_msgs</exec_depend>\n"
        "  <exec_depend>b_msgs</exec_depend>",
    )


def test_nothing_missing_changes_nothing() -> None:
    assert add_dependencies(MANIFEST, ["std_msgs"]) == MANIFEST


def test_a_manifest_without_dependencies_gets_them_at_its_end() -> None:
    text = "<package>\r\n  <name>foo</name>\r\n</package>\r\n"
    assert add_dependencies(text, ["a_msgs"]) == (
        "<package>\r\n  <name>foo</name>\r\n  <exec_depend>a_msgs</exec_depend>\r\n</package>\r\n"
    )
