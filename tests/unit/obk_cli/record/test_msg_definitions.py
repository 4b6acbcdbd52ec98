"""The definition of a type in recordings: complete, each part once, comments kept."""

from pathlib import Path

import pytest

from obk_cli.record.recorder import installed_definition, schema_text

BAR = "=" * 80
TEXTS = {
    ("arm_msgs", "Joints"): (
        "# Of an arm, see Other x.\n"
        'string NAME="Joints"\n'
        "std_msgs/Header header  # when\n"
        "float64[<=7] position\n"
        "Joint[2] joints\n"
        "Joint[] more\n"
    ),
    ("arm_msgs", "Joint"): "float64 angle 0.5\nbuiltin_interfaces/Time stamp\n",
    ("std_msgs", "Header"): "builtin_interfaces/Time stamp\nstring<=9 frame_id\n",
    ("builtin_interfaces", "Time"): "int32 sec\nuint32 nanosec\n",
}


def find(package: str, name: str) -> str | None:
    return TEXTS.get((package, name))


def test_a_type_includes_everything_that_it_refers_to_once() -> None:
    text = schema_text("arm_msgs/msg/Joints", find)
    assert text is not None
    parts = text.split(f"{BAR}\n")
    assert [part.splitlines()[0] for part in parts[1:]] == [
        "MSG: std_msgs/Header",
        "MSG: arm_msgs/Joint",
        "MSG: builtin_interfaces/Time",
    ]
    assert parts[0] == TEXTS["arm_msgs", "Joints"]
    assert parts[3] == "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"


def test_a_type_with_plain_fields_is_its_own_definition() -> None:
    assert schema_text("builtin_interfaces/msg/Time", find) == "int32 sec\nuint32 nanosec\n"


def test_an_incomplete_definition_is_none() -> None:
    texts = {("a", "A"): "b/B part\n"}
    assert schema_text("a/msg/A", lambda *name: texts.get(name)) is None


def test_a_definition_is_read_with_any_encoding_of_comments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "share" / "arm_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Joint.msg").write_bytes("# Größe\nfloat64 angle\n".encode("latin-1"))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    text = installed_definition("arm_msgs", "Joint")
    assert text is not None
    assert text.endswith("float64 angle\n")
    assert installed_definition("arm_msgs", "Wrist") is None
