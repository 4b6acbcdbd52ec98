from pathlib import Path

import pytest

from obk_interfaces import Interface, InterfacePackage
from obk_interfaces.definition import check_definition, check_package
from obk_interfaces.prefix import Prefixes

MESSAGES = frozenset({"my_msgs/Wheel", "geometry_msgs/Vector3", "std_msgs/Header"})


def problems_of(text: str, *, kind: str = "msg", name: str = "Robot") -> list[str]:
    interface = Interface(kind=kind, name=name)
    package = InterfacePackage(
        root=Path("my_msgs"),
        name="my_msgs",
        version="1.0.0",
        depends=("geometry_msgs", "std_msgs"),
        interfaces=(interface,),
    )
    path = Path(interface.file)
    return [
        str(p) for p in check_definition(path, interface, text, package=package, messages=MESSAGES)
    ]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "# a comment\n\n   # another\n",
        'string NAME="a # b"\nfloat64 x 1.5\nint32[] numbers [1, 2]\n',
        "string<=10[<=3] names\nwstring text\nfloat64[9] covariance\n",
        "std_msgs/Header header\ngeometry_msgs/msg/Vector3[<=4] points\nWheel[] wheels\n",
        "uint8 MODE_A = 1 # the first\nuint8\tmode\n",
    ],
)
def test_definitions_that_rosidl_accepts_are_accepted(text: str) -> None:
    assert problems_of(text) == []


@pytest.mark.parametrize(
    ("word", "languages"),
    [
        ("short", "C and C++"),
        ("for", "C, C++ and Python"),
        ("class", "C++ and Python"),
        ("from", "Python"),
        ("xor", "C++"),
    ],
)
def test_a_keyword_is_rejected_with_its_location_and_languages(word: str, languages: str) -> None:
    assert problems_of(f"float64 x\n  int32 {word}\n") == [
        f"msg/Robot.msg:2:9: `{word}` is a keyword in {languages}: "
        "the generated code would not compile\n"
        f"  help: choose another name, such as `{word}_value`"
    ]


def test_all_problems_of_a_file_are_reported_together() -> None:
    found = problems_of("floa64 x\nint32 Big\nint32 low_value = 3\nint32\nfloat64 x\n")
    assert [line.partition("\n")[0] for line in found] == [
        "msg/Robot.msg:1:1: the type `floa64` is not known",
        "msg/Robot.msg:2:7: `Big` cannot be the name of a field",
        "msg/Robot.msg:3:7: `low_value` cannot be the name of a constant",
        "msg/Robot.msg:4:1: `int32` is not followed by a name",
        "msg/Robot.msg:5:9: `x` is already defined on line 1",
    ]


@pytest.mark.parametrize(
    ("wrong", "help"),
    [
        ("floa64", "did you mean `float64` or `float32`?"),
        ("Whel", "did you mean `Wheel`?"),
        ("Header", "did you mean `std_msgs/Header`?"),
        ("geometry_msgs/Vector", "did you mean `geometry_msgs/Vector3`?"),
        (
            "nav_msgs/Odometry",
            "neither package.xml nor CMakeLists.txt declares a dependency on `nav_msgs`: "
            "add `<depend>nav_msgs</depend>` to package.xml",
        ),
    ],
)
def test_an_unknown_type_has_a_suggestion(wrong: str, help: str) -> None:
    assert problems_of(f"{wrong} value\n") == [
        f"msg/Robot.msg:1:1: the type `{wrong}` is not known\n  help: {help}"
    ]


@pytest.mark.parametrize("wrong", ["float64<=3", "float64[", "int32[<3]", "9lives"])
def test_an_invalid_type_has_examples(wrong: str) -> None:
    (problem,) = problems_of(f"{wrong} value\n")
    assert problem.startswith(f"msg/Robot.msg:1:1: `{wrong}` is not a type\n  help: examples: ")


@pytest.mark.parametrize(
    ("kind", "text", "has", "wants"),
    [("msg", "---\n", 1, 0), ("srv", "int32 a\n", 0, 1), ("action", "---\n", 1, 2)],
)
def test_a_wrong_number_of_sections_is_reported(kind: str, text: str, has: int, wants: int) -> None:
    assert problems_of(text, kind=kind) == [
        f"{kind}/Robot.{kind}:1:1: the number of `---` lines is {has}, expected {wants} "
        f"in a .{kind} file"
    ]


def test_sections_may_use_the_same_name() -> None:
    assert problems_of("int32 a\n---\nint32 a\n", kind="srv") == []


def test_an_invalid_file_name_is_rejected() -> None:
    (problem,) = problems_of("int32 a\n", name="robot_state")
    assert problem.startswith("msg/robot_state.msg:1:1: `robot_state` cannot be the name")


def test_text_that_is_not_utf8_is_reported_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "msg").mkdir()
    (tmp_path / "msg" / "A.msg").write_bytes(b"int32 a\n# \xff\n")
    package = InterfacePackage(
        root=tmp_path,
        name="my_msgs",
        version="1.0.0",
        depends=(),
        interfaces=(Interface(kind="msg", name="A"),),
    )
    (problem,) = check_package(package, {}, Prefixes(layers=(), ros=tmp_path))
    assert str(problem).startswith(f"{tmp_path}/msg/A.msg:2:1: ")


@pytest.mark.parametrize("name", ["A", "AB", "A_B", "A1_2", "A" * 60 + "_B"])
def test_a_constants_name_follows_rosidl(name: str) -> None:
    assert problems_of(f"uint8 {name}=1\n") == []


@pytest.mark.parametrize("name", ["A_", "A__B", "_A", "1A", "Ab", "A" * 60 + "_rad", "AB_" * 60])
def test_an_invalid_name_of_a_constant_is_rejected_in_linear_time(name: str) -> None:
    (problem,) = problems_of(f"uint8 {name}=1\n")
    assert problem.startswith(f"msg/Robot.msg:1:7: `{name}` cannot be the name of a constant")


@pytest.mark.parametrize("line", ["float64 float", "int32 int", "Wheel wheel_"])
def test_a_name_that_is_part_of_its_type_has_its_own_location(line: str) -> None:
    (problem,) = problems_of(f"{line}\n")
    assert problem.startswith(f"msg/Robot.msg:1:{line.index(' ') + 2}: ")
