"""The C++ packages: names agree in all files, and a compiler accepts the code.

The real library is not available here, so the tests use fakes of its headers.
"""

import re
import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

import pytest

from obelisk_spec.parameter_notes import parse_notes
from obk_cli.scaffold.message_code import cpp_header
from obk_cli.scaffold.package_spec import MessageType
from obk_cli.scaffold.templates import RenderedFile

Package = Callable[..., dict[PurePosixPath, RenderedFile]]

COMPILER = next((path for name in ("g++", "clang++", "c++") if (path := shutil.which(name))), None)
OPTIONS = ("-std=c++17", "-Wall", "-Wextra")
VARIANTS = [
    ("controller", "foo", {}),
    ("controller", "leg_pd_controller", {"ctrl_msg": "PDFeedForward"}),
    ("controller", "foo", {"ctrl_msg": "VelocityCommand", "est_msg": "nav_msgs/Odometry"}),
    ("controller", "foo", {"ctrl_msg": "a_msgs/Thrust"}),
    ("estimator", "foo", {}),
    ("estimator", "foo", {"sensor_msg": "JointEncoders"}),
    ("estimator", "foo", {"sensor_msg": "sensor_msgs/Imu", "est_msg": "a_msgs/IMU"}),
]

STANDARD = """\
#include <functional>
#include <memory>
#include <string>
#include <vector>
"""
"""Headers that the fakes include in every source file anyway."""
NODE_STAND_IN = """\
#pragma once
#include <functional>
#include <memory>
#include <string>
#include "rclcpp/rclcpp.hpp"
namespace obelisk {
template <typename T> struct Publisher { void publish(const T&) {} };
class ObeliskNode {
public:
    explicit ObeliskNode(const std::string&) {}
    virtual ~ObeliskNode() = default;
    std::shared_ptr<rclcpp::Clock> get_clock() { return std::make_shared<rclcpp::Clock>(); }
    template <typename T, typename D>
    T declare_parameter(const std::string&, const T& value, const D&) { return value; }
    rclcpp::Parameter get_parameter(const std::string&) { return {}; }
protected:
    template <typename T> std::shared_ptr<Publisher<T>> GetPublisher(const std::string&) {
        return std::make_shared<Publisher<T>>();
    }
    template <typename T> void RegisterObkSubscription(
        %s, std::function<void(const T&)>%s) {}
};
}
"""
NEWEST = "2026"
REGISTRATION = {
    "v0.4": ("const std::string&, const std::string&", ", const std::string&"),
    "2026": ("const std::string&", ""),
}
"""The code before and after the callback in each release of the library."""
STAND_INS = {
    "rclcpp/rclcpp.hpp": """\
#pragma once
namespace rclcpp {
struct Duration { double seconds() const { return 0.0; } };
struct Time {
    double seconds() const { return 0.0; }
    Duration operator-(const Time&) const { return {}; }
};
struct Parameter { double as_double() const { return 0.0; } };
struct Clock { Time now() { return {}; } };
namespace executors { struct MultiThreadedExecutor {}; }
}
""",
    "obelisk_controller.h": """\
#pragma once
#include "obelisk_node.h"
namespace obelisk {
template <typename C, typename E> class ObeliskController : public ObeliskNode {
public:
    explicit ObeliskController(const std::string& name) : ObeliskNode(name) {}
protected:
    virtual void UpdateXHat(const E&) = 0;
    virtual C ComputeControl() = 0;
    const std::string ctrl_key_ = "pub_ctrl";
};
}
""",
    "obelisk_estimator.h": """\
#pragma once
#include "obelisk_node.h"
namespace obelisk {
template <typename E> class ObeliskEstimator : public ObeliskNode {
public:
    explicit ObeliskEstimator(const std::string& name) : ObeliskNode(name) {}
protected:
    virtual E ComputeStateEstimate() = 0;
    const std::string est_pub_key_ = "pub_est";
};
}
""",
    "obelisk_ros_utils.h": """\
#pragma once
#include <string>
namespace obelisk::utils {
template <typename N, typename E> void SpinObelisk(int, char**, const std::string& name) {
    N node(name);
    E executor;
    (void)executor;
}
}
""",
}
FIELDS = {
    "ParameterDescriptor": "std::string description, additional_constraints; "
    "struct Range { double from_value, to_value; }; std::vector<Range> floating_point_range;",
    "PositionSetpoint": "Header header; std::vector<double> u_mujoco, q_des;",
    "PDFeedForward": "Header header; std::vector<double> u_mujoco;",
    "VelocityCommand": "Header header; double v_x, v_y, w_z;",
    "EstimatedState": "Header header; std::vector<double> q_joints, v_joints; "
    "std::vector<std::string> joint_names;",
    "JointEncoders": "Header header; std::vector<double> y;",
    "ObkJointEncoders": "Header header; std::vector<double> joint_pos, joint_vel; "
    "std::vector<std::string> joint_names;",
}


def text_of(files: dict[PurePosixPath, RenderedFile], path: str) -> str:
    return files[PurePosixPath(path)].content.decode()


def includes_of(files: dict[PurePosixPath, RenderedFile]) -> set[str]:
    code = (f.content.decode() for f in files.values() if f.path.suffix == ".cpp")
    return {name for text in code for name in re.findall(r'#include "([^"]+)"', text)}


def message_stand_in(header: str, code: str) -> str:
    package = header.split("/")[0]
    used = re.findall(rf"\b{package}::msg::(\w+)", code)
    name = next(n for n in used if cpp_header(MessageType(package=package, name=n)) == header)
    return (
        "#pragma once\n#include <string>\n#include <vector>\n"
        '#include "rclcpp/rclcpp.hpp"\n'
        f"namespace {package}::msg {{ struct {name} {{ struct Header {{ rclcpp::Time stamp; }}; "
        f"{FIELDS.get(name, '')} }}; }}\n"
    )


@pytest.mark.parametrize(
    ("name", "header"),
    [
        ("PositionSetpoint", "position_setpoint"),
        ("PDFeedForward", "pd_feed_forward"),
        ("ExecutionFSM", "execution_fsm"),
        ("UInt8MultiArray", "u_int8_multi_array"),
        ("Pose2D", "pose2_d"),
        ("A", "a"),
    ],
)
def test_a_header_has_the_name_used_by_ros(name: str, header: str) -> None:
    """Source: rosidl's generators, which convert `X2Y` to `x2_y`."""
    assert cpp_header(MessageType(package="a_msgs", name=name)) == f"a_msgs/msg/{header}.hpp"


@pytest.mark.parametrize(("kind", "name", "typed"), VARIANTS)
def test_the_names_agree_over_all_files(
    package: Package, kind: str, name: str, typed: dict[str, str]
) -> None:
    files = package(kind, name, language="cpp", **typed)
    cmake, manifest = text_of(files, "CMakeLists.txt"), text_of(files, "package.xml")
    depends = {e.text for e in ElementTree.fromstring(manifest).iter("depend")}
    assert set(re.findall(r"find_package\((\w+)", cmake)) == {"ament_cmake", *depends}
    linked = cmake.partition(f"target_link_libraries({name} PRIVATE")[2].partition(")")[0].split()
    messages = {f"${{{package}_TARGETS}}" for package in depends - {"rclcpp"}}
    assert set(linked) == {"Obelisk::Core", "rclcpp::rclcpp", *messages}
    assert f"project({name})" in cmake
    sources = re.findall(r"add_executable\(\w+ (.*)\)", cmake)[0].split()
    assert all(PurePosixPath(source) in files for source in sources)
    assert f"install(TARGETS {name} DESTINATION lib/${{PROJECT_NAME}})" in cmake
    for header in includes_of(files):
        top = header.split("/")[0]
        assert header.startswith("obelisk_") or top in depends, header


@pytest.mark.parametrize(("kind", "name", "typed"), VARIANTS)
def test_every_bracket_is_closed(
    package: Package, kind: str, name: str, typed: dict[str, str]
) -> None:
    for file in package(kind, name, language="cpp", **typed).values():
        text = file.content.decode()
        for opening, closing in ("{}", "()", "[]"):
            assert text.count(opening) == text.count(closing), file.path


def test_the_entry_is_as_obelisk_has_it(package: Package) -> None:
    source = text_of(package("controller", "foo", language="cpp"), "src/foo.cpp")
    assert "obelisk::utils::SpinObelisk<foo::FooController, " in source
    assert 'argc, argv, "foo");' in source


@pytest.mark.parametrize(("kind", "name"), [("controller", "amplitude"), ("estimator", "max_age")])
def test_a_parameter_is_declared_once_and_read_in_each_callback(
    package: Package, kind: str, name: str
) -> None:
    source = text_of(package(kind, "foo", language="cpp"), "src/foo.cpp")
    declared, _, rest = source.partition("protected:")
    assert declared.count(f'this->declare_parameter("{name}"') == 1
    assert rest.count(f'this->get_parameter("{name}").as_double()') == 1
    (notes,) = re.findall(r'additional_constraints =\s+"(.*)"', declared)
    assert parse_notes(notes).is_live


def test_an_estimator_reads_a_message_that_the_library_s_users_have(package: Package) -> None:
    source = text_of(package("estimator", "foo", language="cpp"), "src/foo.cpp")
    assert "obelisk_sensor_msgs::msg::ObkJointEncoders" in source
    assert "msg.q_joints = sensor_msg_->joint_pos;" in source


@pytest.fixture(scope="module")
def stand_ins(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The fakes of the library's headers by release, with precompiled standard headers."""
    folders = {}
    for release, registration in REGISTRATION.items():
        folders[release] = folder = tmp_path_factory.mktemp("stand_ins")
        node = NODE_STAND_IN % registration
        write(folder, STAND_INS | {"obelisk_node.h": node, "standard.h": STANDARD})
        if COMPILER is not None:
            compiled(COMPILER, *OPTIONS, "-x", "c++-header", "standard.h", cwd=folder)
    return folders


def write(folder: Path, contents: Mapping[str, str | bytes]) -> None:
    for path, content in contents.items():
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content.encode() if isinstance(content, str) else content)


def compiled(*command: str, cwd: Path) -> None:
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr


def compiled_variants() -> Iterator[object]:
    """Every variant for the latest release; for older ones, most variants are slow tests."""
    for release in REGISTRATION:
        kinds = set()
        for kind, name, typed in VARIANTS:
            is_slow = release != NEWEST and kind in kinds
            kinds.add(kind)
            marks = [pytest.mark.slow] if is_slow else []
            yield pytest.param(kind, name, typed, release, marks=marks)


@pytest.mark.parametrize(("kind", "name", "typed", "release"), [*compiled_variants()])
def test_a_compiler_takes_it(
    package: Package,
    stand_ins: dict[str, Path],
    tmp_path: Path,
    kind: str,
    name: str,
    typed: dict[str, str],
    release: str,
) -> None:
    if COMPILER is None:  # what can be checked without a compiler is tested above
        return
    files = package(kind, name, language="cpp", release=release, **typed)
    code = "".join(f.content.decode() for f in files.values() if f.path.suffix == ".cpp")
    messages = (header for header in includes_of(files) if "/msg/" in header)
    write(tmp_path / "messages", {header: message_stand_in(header, code) for header in messages})
    write(tmp_path / "package", {str(file.path): file.content for file in files.values()})
    folders = (tmp_path / "messages", stand_ins[release])
    for source in (tmp_path / "package/src").iterdir():
        places = [option for folder in folders for option in ("-I", str(folder))]
        options = (*OPTIONS, "-Werror", "-fsyntax-only", *places, "-include", "standard.h")
        compiled(COMPILER, *options, str(source), cwd=tmp_path)
