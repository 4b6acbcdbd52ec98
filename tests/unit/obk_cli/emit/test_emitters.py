import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obelisk_spec.yaml_core import load_yaml_core
from obk_cli.emit.json import emit_plan
from obk_cli.emit.params import emit_params, params_file_name
from obk_cli.files import write_text
from obk_cli.plan.plan import Plan, PlannedNode

from ..plans import node  # noqa: TID252 - shared by folders of tests

TEXT = st.text(st.characters(exclude_categories=["Cs"]))
VALUES = (
    st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
    | TEXT
    | st.lists(st.integers(0, 9), min_size=1).map(tuple)
    | st.lists(TEXT, min_size=1).map(tuple)
)


def process(**parameters: object) -> PlannedNode:
    return node("obelisk_control_0", namespace="/left", parameters=parameters)


def test_a_parameter_file_literally() -> None:
    text = emit_params(
        [process(on="on", n=3, x=1.0, tiny=1e-7, flag=True, names=("a", "1"), inf=float("inf"))]
    )
    assert text == (
        "/left/obelisk_control_0:\n"
        "  ros__parameters:\n"
        '    "on": "on"\n'
        '    "n": 3\n'
        '    "x": 1.0\n'
        '    "tiny": 1e-07\n'
        '    "flag": true\n'
        '    "names": ["a", "1"]\n'
        '    "inf": .inf\n'
    )


@given(st.dictionaries(TEXT.filter(bool), VALUES))
def test_another_reader_reads_the_intended_values(parameters: dict[str, object]) -> None:
    text = emit_params([process(**parameters)])
    loaded = load_yaml_core(text)
    assert isinstance(loaded, dict)
    node = loaded["/left/obelisk_control_0"]["ros__parameters"]
    read = {n: tuple(v) if isinstance(v, list) else v for n, v in node.items()}
    assert read == parameters


def test_a_plan_is_json() -> None:
    plan = json.loads(emit_plan(Plan(name="arm", nodes=(process(a=(1, 2)),))))
    assert plan["name"] == "arm"
    assert plan["processes"][0]["parameters"] == {"a": [1, 2]}
    assert plan["processes"][0]["origin"] == {"path": "c.yaml", "line": 1, "column": 1}


def test_each_process_has_its_own_file_name() -> None:
    assert params_file_name(process()) == "left.obelisk_control_0.yaml"


def test_a_file_is_written_only_when_it_changes(tmp_path: Path) -> None:
    path = tmp_path / "new" / "f.yaml"
    assert write_text(path, "a\n")
    assert not write_text(path, "a\n")
    assert write_text(path, "b\n")
    assert path.read_text() == "b\n"
    assert [p.name for p in path.parent.iterdir()] == ["f.yaml"]


def test_a_folder_in_the_way_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "f").mkdir()
    with pytest.raises(OSError, match="f"):
        write_text(tmp_path / "f", "a")
    assert [p.name for p in tmp_path.iterdir()] == ["f"]
