from collections.abc import Callable
from pathlib import PurePosixPath

import pytest

from obk_cli.scaffold.package_spec import PackageSpec
from obk_cli.scaffold.templates import (
    RenderedFile,
    Template,
    TemplateFaultError,
    render_templates,
)
from obk_cli.scaffold.variables import template_variables

Package = Callable[..., dict[PurePosixPath, RenderedFile]]


def text_of(files: dict[PurePosixPath, RenderedFile], path: str) -> str:
    return files[PurePosixPath(path)].content.decode()


def render_one(name: str, content: str, **variables: object) -> RenderedFile:
    (file,) = render_templates([Template(name=name, content=content.encode())], variables)
    return file


@pytest.mark.parametrize("kind", ["controller", "estimator", "robot", "sensor"])
def test_a_package_has_everything_that_ament_python_requires(package: Package, kind: str) -> None:
    files = package(kind, "foo")
    assert {str(path) for path in files} == {
        "foo/__init__.py",
        "foo/foo.py",
        "package.xml",
        "pyproject.toml",
        "setup.py",
        "test/foo.yaml",
        "test/test_foo.py",
    }
    assert "<build_type>ament_python</build_type>" in text_of(files, "package.xml")
    assert '"install_scripts": "$base/lib/" + package_name' in text_of(files, "setup.py")
    assert '"foo = foo.foo:main",' in text_of(files, "setup.py")
    assert all(file.mode == 0o644 for file in files.values())


def test_a_controller_has_its_types_filled_in(package: Package) -> None:
    node = text_of(package(), "foo/foo.py")
    assert "from obelisk_control_msgs.msg import PositionSetpoint\n" in node
    assert "def update_x_hat(self, x_hat_msg: EstimatedState) -> None:" in node
    assert "def compute_control(self) -> PositionSetpoint:" in node
    assert "msg.u_mujoco = [u]" in node
    assert 'self.obk_publishers["pub_ctrl"].publish(msg)' in node


def test_an_estimator_registers_its_sensor(package: Package) -> None:
    node = text_of(package("estimator", sensor_msg="ObkJointEncoders"), "foo/foo.py")
    assert '"sub_sensor_setting",' in node
    assert "msg_type=ObkJointEncoders," in node
    assert "msg.q_joints = self.sensor_msg.joint_pos" in node


@pytest.mark.parametrize(
    ("sensor_msg", "stamp"),
    [
        ("ObkJointEncoders", "self.sensor_msg.header.stamp"),
        ("ObkImage", "self.get_clock().now().to_msg()"),
    ],
)
def test_an_estimate_has_the_stamp_of_its_sensor_if_it_has_one(
    package: Package, sensor_msg: str, stamp: str
) -> None:
    node = text_of(package("estimator", sensor_msg=sensor_msg), "foo/foo.py")
    assert f"msg.header.stamp = {stamp}\n" in node


@pytest.mark.parametrize(
    ("ctrl_msg", "line"),
    [
        ("PDFeedForward", "msg.u_mujoco = [u]"),
        ("VelocityCommand", "msg.v_x = self.amplitude * math.sin(self.t)"),
        ("ExecutionFSM", "msg.header.stamp = self.get_clock().now().to_msg()"),
        ("TwistStamped", "msg.header.stamp = self.get_clock().now().to_msg()"),
    ],
)
def test_a_control_message_gets_the_fields_that_it_has(
    package: Package, ctrl_msg: str, line: str
) -> None:
    assert line in text_of(package(ctrl_msg=ctrl_msg), "foo/foo.py")


def test_nothing_is_written_into_a_message_of_unknown_fields(package: Package) -> None:
    node = text_of(package(ctrl_msg="my_msgs/Thrust"), "foo/foo.py")
    assert "msg." not in node.partition("def compute_control")[2].replace("of msg", "")
    assert "# the other fields of msg are yours to fill" in node
    assert "import math" not in node


def test_package_xml_names_the_message_packages(package: Package) -> None:
    manifest = text_of(package("estimator", sensor_msg="Imu"), "package.xml")
    for name in ("obelisk_estimator_msgs", "sensor_msgs", "rclpy"):
        assert f"<exec_depend>{name}</exec_depend>" in manifest


def test_a_variable_that_does_not_exist_is_a_fault_with_its_template() -> None:
    with pytest.raises(TemplateFaultError, match=r"a\.jinja: 'nothing' is undefined"):
        render_one("a.jinja", "{{ nothing }}")


def test_a_template_that_does_not_parse_is_a_fault_with_its_line() -> None:
    with pytest.raises(TemplateFaultError, match=r"a\.jinja:2: "):
        render_one("a.jinja", "fine\n{% if %}")


def test_a_template_cannot_reach_out_of_the_sandbox() -> None:
    with pytest.raises(TemplateFaultError, match="unsafe"):
        render_one("a.jinja", "{{ ''.__class__.__mro__[1].__subclasses__() }}")


@pytest.mark.parametrize("name", ["../out.jinja", "{{ up }}/x.jinja", "{{ root }}x.jinja"])
def test_a_template_cannot_name_a_file_outside_the_package(name: str) -> None:
    with pytest.raises(TemplateFaultError, match="outside the package"):
        render_one(name, "", up="..", root="/")


def test_only_jinja_files_are_rendered() -> None:
    file = render_one("{{ a }}.txt", "{{ kept }}", a="b")
    assert file == RenderedFile(path=PurePosixPath("b.txt"), content=b"{{ kept }}")


def test_a_script_is_executable() -> None:
    assert render_one("run", "#!/bin/sh\n").mode == 0o755


def test_rendering_twice_gives_equal_bytes(
    make_spec: Callable[..., PackageSpec], templates: Callable[[PackageSpec], tuple[Template, ...]]
) -> None:
    spec = make_spec()
    variables = template_variables(spec)
    once = render_templates(templates(spec), variables)
    assert once == render_templates(templates(spec), variables)
