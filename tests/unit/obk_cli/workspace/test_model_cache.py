import json
from pathlib import Path

import pytest

from obk_cli.config.environment import ModelFault, ModelRead
from obk_cli.optional_deps import distribution_version
from obk_cli.workspace import model_reader
from obk_cli.workspace.model_reader import cache_folder, read_model_once

pytestmark = pytest.mark.mujoco

MODELS = Path(__file__).parents[3] / "cases" / "workspace" / "demo_model" / "mujoco"
CORPUS = Path(__file__).resolve().parents[5] / "shared/corpus/field"


def never(path: Path) -> ModelRead:
    raise AssertionError(f"{path} is read again")


@pytest.mark.parametrize(
    "path",
    [MODELS / "arm.xml", MODELS / "meshless.xml", CORPUS / "go2_description/mujoco/go2_scene.xml"],
    ids=lambda path: path.name,
)
def test_a_model_is_read_once_and_then_known(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = read_model_once(path, tmp_path)
    monkeypatch.setattr(model_reader, "read_model_bounded", never)
    assert read_model_once(path, tmp_path) == first


def copied(folder: Path) -> Path:
    model = folder / "model" / "arm.xml"
    model.parent.mkdir()
    model.write_bytes((MODELS / "arm.xml").read_bytes())
    return model


def test_a_model_that_changed_is_read_again(tmp_path: Path) -> None:
    model = copied(tmp_path)
    read_model_once(model, tmp_path / "cache")
    text = model.read_text().replace('name="hinge"', 'name="elbow"')
    model.write_text(text.replace('joint="hinge"', 'joint="elbow"'))
    read = read_model_once(model, tmp_path / "cache")
    assert isinstance(read, ModelRead)
    assert "elbow" in read.facts.joints


def test_a_model_with_a_fault_is_not_kept(tmp_path: Path) -> None:
    read = read_model_once(MODELS / "misspelled.xml", tmp_path / "cache")
    assert isinstance(read, ModelFault)
    assert not (tmp_path / "cache").exists()


def test_a_fragment_that_changed_makes_the_model_read_again(tmp_path: Path) -> None:
    main, part = tmp_path / "main.xml", tmp_path / "part.xml"
    main.write_text('<mujoco><include file="part.xml"/></mujoco>')
    for name in ("a", "b"):
        part.write_text(f'<mujoco><worldbody><site name="{name}"/></worldbody></mujoco>')
        read = read_model_once(main, tmp_path / "cache")
        assert isinstance(read, ModelRead)
        assert read.facts.sites == (name,)


def test_a_mesh_that_went_missing_is_reported_from_the_cache_too(tmp_path: Path) -> None:
    model = copied(tmp_path)
    model.write_bytes((MODELS / "meshless.xml").read_bytes())
    mesh = model.parent / "meshes" / "trunk.stl"
    mesh.parent.mkdir()
    mesh.touch()
    there = read_model_once(model, tmp_path / "cache")
    mesh.unlink()
    gone = read_model_once(model, tmp_path / "cache")
    assert isinstance(there, ModelRead)
    assert isinstance(gone, ModelRead)
    assert (there.missing_files, gone.missing_files) == ((), ("meshes/trunk.stl",))


BROKEN = ("", "[]", "{", '{"facts": {"sensors": 1}}', "null", "[" * 100_000)


@pytest.mark.parametrize("held", BROKEN, ids=range(len(BROKEN)))
def test_a_broken_entry_is_ignored(held: str, tmp_path: Path) -> None:
    first = read_model_once(MODELS / "arm.xml", tmp_path)
    (entry,) = tmp_path.glob("*.json")
    assert json.loads(entry.read_text())["facts"]["position_servos"] == 1
    entry.write_text(held)
    assert read_model_once(MODELS / "arm.xml", tmp_path) == first


def test_a_read_only_cache_is_no_fault(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    read = read_model_once(MODELS / "arm.xml", tmp_path / "file" / "cache")
    assert isinstance(read, ModelRead)


def test_a_model_that_attaches_others_is_not_kept(tmp_path: Path) -> None:
    (tmp_path / "part.xml").write_bytes((MODELS / "coarse.xml").read_bytes())
    model = tmp_path / "main.xml"
    model.write_text('<mujoco><asset><model name="p" file="part.xml"/></asset></mujoco>')
    read_model_once(model, tmp_path / "cache")
    assert not (tmp_path / "cache").exists()


def test_entries_do_not_pile_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_reader, "_MOST_ENTRIES", 1)
    for name in ("arm.xml", "coarse.xml", "meshless.xml"):
        read_model_once(MODELS / name, tmp_path)
    assert len(list(tmp_path.iterdir())) == 1


def test_the_cache_is_in_the_users_cache_folder(tmp_path: Path) -> None:
    assert cache_folder({}) is None
    assert cache_folder({"HOME": str(tmp_path / "nowhere")}) is None
    assert cache_folder({"HOME": str(tmp_path)}) == tmp_path / ".cache" / "obelisk" / "models"
    assert cache_folder({"XDG_CACHE_HOME": "/c"}) == Path("/c/obelisk/models")


def test_a_distribution_is_found_by_any_form_of_its_name() -> None:
    assert distribution_version("PyYAML") == distribution_version("pyyaml") is not None
    assert distribution_version("obelisk.cli") is not None
    assert distribution_version("no-such-distribution") is None


def test_a_model_is_compiled_once_its_files_exist(tmp_path: Path) -> None:
    model = tmp_path / "model.xml"
    model.write_text(
        '<mujoco><asset><mesh file="part.obj"/></asset><worldbody><body><joint name="elbow"/>'
        '<geom type="mesh" mesh="part"/></body></worldbody>'
        '<actuator><motor joint="elbw"/></actuator></mujoco>'
    )
    read = read_model_once(model, tmp_path / "cache")
    assert isinstance(read, ModelRead)
    assert (read.missing_files, read.fault) == (("part.obj",), None)
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    (tmp_path / "part.obj").write_text(f"{corners}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    read = read_model_once(model, tmp_path / "cache")
    assert isinstance(read, ModelRead)
    assert read.fault is not None
    assert "elbw" in read.fault.message
