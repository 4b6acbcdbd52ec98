"""Reading models: locations of elements, and MuJoCo's errors."""

import os
import sys
from pathlib import Path

import pytest

from obk_cli.config.environment import ModelFault, ModelRead
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.model_reader import missing_files, mjcf_elements, mjcf_files, read_model

MODELS = Path(__file__).parents[3] / "cases/workspace/demo_model/mujoco"
CORPUS = Path(__file__).resolve().parents[5] / "shared/corpus/field"


def test_elements_are_found_at_their_location_through_includes(tmp_path: Path) -> None:
    (tmp_path / "top.xml").write_text(
        '<mujoco>\n  <include file="part.xml"/>\n  <geom name="a"/>\n</mujoco>'
    )
    (tmp_path / "part.xml").write_text(
        '<mujoco>\n<sensor>\n  <gyro\n name="g"/></sensor><include file="top.xml"/></mujoco>'
    )
    places = {
        (e.kind, e.name): (e.path.name, e.line, e.column)
        for e in mjcf_elements(tmp_path / "top.xml")
    }
    assert places == {("geom", "a"): ("top.xml", 3, 3), ("sensor", "g"): ("part.xml", 3, 3)}


@pytest.mark.parametrize("content", [b"", b"<mujoco><geom name='a'/>", b"\xff\xfe", b"not xml"])
def test_invalid_xml_has_the_elements_before_the_fault(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "m.xml").write_bytes(content)
    assert len(list(mjcf_elements(tmp_path / "m.xml"))) == (1 if b"geom" in content else 0)
    assert list(mjcf_elements(tmp_path / "none.xml")) == []


def test_an_element_of_several_lines_is_underlined_on_its_first(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text('<mujoco><sensor>\n  <gyro\n    name="g"/></sensor></mujoco>')
    environment = MachineEnvironment(tmp_path, tmp_path, {})
    span = environment.model_element(tmp_path / "m.xml", "sensor", "g")
    assert span is not None
    assert (str(span), span.text) == ("m.xml:2:3", "<gyro")
    assert environment.model_element(tmp_path / "m.xml", "geom", "g") is None


@pytest.mark.mujoco
def test_an_error_that_quotes_invalid_utf8_is_a_message_of_mujoco(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_bytes(b"<mujoco><worldbody><geom ma\xff='1'/></worldbody></mujoco>")
    fault = read_model(tmp_path / "m.xml")
    assert isinstance(fault, ModelFault)
    # The choice depends on the version of Python.
    assert "ma\ufffd" in fault.message or "MuJoCo rejects it" in fault.message


@pytest.mark.mujoco
@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("<mujoco>\n<worldbody><geom typ='box'/></worldbody></mujoco>", 2, "'typ'"),
        (
            "<mujoco>\n<worldbody>\n</mujoco>",
            2,
            "not well-formed XML: mismatched element (`worldbody`)",
        ),
        ("", None, ""),
        ("<urdf/>", None, ""),
    ],
)
def test_mujocos_error_becomes_a_message_with_its_line(
    tmp_path: Path, text: str, line: int | None, message: str
) -> None:
    (tmp_path / "m.xml").write_text(text)
    fault = read_model(tmp_path / "m.xml")
    assert isinstance(fault, ModelFault)
    assert message in fault.message
    assert "\n" not in fault.message
    if line is not None:
        assert fault.line == line


@pytest.mark.mujoco
def test_meshes_may_be_missing_and_are_named() -> None:
    read = read_model(CORPUS / "go2_description/mujoco/go2_scene.xml")
    assert isinstance(read, ModelRead)
    assert len(read.facts.actuators) == 36
    assert "../meshes/trunk.stl" in read.missing_files
    assert read_model(CORPUS / "go2_description/mujoco/go2.xml") is not None


@pytest.mark.mujoco
def test_an_existing_mesh_is_not_missing(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text((MODELS / "meshless.xml").read_text())
    read = read_model(tmp_path / "m.xml")
    assert isinstance(read, ModelRead)
    assert read.missing_files == ("meshes/trunk.stl",)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "trunk.stl").touch()
    read = read_model(tmp_path / "m.xml")
    assert isinstance(read, ModelRead)
    assert read.missing_files == ()


@pytest.mark.mujoco
def test_the_choice_of_a_renderer_is_left_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "egl")
    read_model(MODELS / "arm.xml")
    assert os.environ["MUJOCO_GL"] == "egl"


def test_a_file_is_walked_once_however_often_it_is_included(tmp_path: Path) -> None:
    """Each of a long series of files includes the next one twice, by two paths."""
    count = 60
    for number in range(count):
        both = (f"{number + 1}.xml", f"../{tmp_path.name}/{number + 1}.xml")
        includes = "".join(f'<include file="{path}"/>' for path in both)
        (tmp_path / f"{number}.xml").write_text(
            f'<mujoco>{includes}<geom name="g{number}"/></mujoco>'
        )
    names = [element.name for element in mjcf_elements(tmp_path / "0.xml")]
    assert names == [f"g{number}" for number in range(count)]
    # The last one does not exist.
    assert len(list(mjcf_files(tmp_path / "0.xml"))) == count + 1


def test_a_row_of_includes_may_be_longer_than_python_calls_deep(tmp_path: Path) -> None:
    count = sys.getrecursionlimit() + 10
    for number in range(count):
        text = f'<mujoco><include file="{number + 1}.xml"/></mujoco>'
        (tmp_path / f"{number}.xml").write_text(text)
    assert len(list(mjcf_files(tmp_path / "0.xml"))) == count + 1
    assert list(mjcf_elements(tmp_path / "0.xml")) == []


def test_a_pipe_among_the_files_of_a_model_does_not_block(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.xml")
    model = tmp_path / "m.xml"
    model.write_text(
        '<mujoco><include file="pipe.xml"/><include file="/dev/zero"/><geom name="g"/></mujoco>'
    )
    assert [element.name for element in mjcf_elements(model)] == ["g"]
    assert [path.name for path in mjcf_files(model)] == ["m.xml", "pipe.xml", "zero"]


@pytest.mark.parametrize("encoding", ["gbk", "utf-32", "no-such-thing"])
def test_a_model_is_read_as_utf8_whatever_it_declares(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "m.xml").write_text(
        f'<?xml version="1.0" encoding="{encoding}"?>\n<mujoco><geom name="\u957f"/></mujoco>',
        encoding="utf-8",
    )
    (element,) = mjcf_elements(tmp_path / "m.xml")
    assert (element.name, element.line, element.column) == ("\u957f", 2, 9)


def test_files_that_no_disk_can_have_are_missing(tmp_path: Path) -> None:
    long = "a" * 300 + ".stl"
    assert missing_files([(long, long)], tmp_path / "m.xml") == (long,)


@pytest.mark.mujoco
def test_a_mesh_that_is_a_pipe_is_missing(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "m.stl")
    (tmp_path / "m.xml").write_text('<mujoco><asset><mesh name="m" file="m.stl"/></asset></mujoco>')
    read = read_model(tmp_path / "m.xml")
    assert isinstance(read, ModelRead)
    assert read.missing_files == ("m.stl",)
