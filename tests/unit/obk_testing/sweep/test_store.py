"""Results of a sweep on disk."""

from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError, MisuseError
from obk_testing.sweep.cases import Row, SweepCase
from obk_testing.sweep.store import SweepStore, hashes_of, installed_sources

CASE = SweepCase(
    test="t.py::test_a", node_id="t.py::test_a[seed1]", seed=1, overrides=(("a.b", "2"),)
)
ROW = Row(
    key=CASE.key,
    outcome="failed",
    why="assert 1 < 0",
    metrics={"worst": 1.5, "kind": "push"},
    digest="12ab",
    seconds=0.5,
    worker="host:12",
)


def test_a_result_exists_for_the_next_sweep(tmp_path: Path) -> None:
    with SweepStore(tmp_path / "out") as store:
        assert store.rows() == {}
        store.add(CASE, ROW)
        store.add_note("note")
        store.add_note("note")
        (store.scratch / "left behind").touch()
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["sweep.sqlite"]
    with SweepStore(tmp_path / "out") as store:
        assert store.rows() == {CASE.key: ROW}
        assert store.notes() == ("note",)
        assert not list(store.scratch.iterdir())


def test_a_restart_keeps_results_until_they_are_removed(tmp_path: Path) -> None:
    with SweepStore(tmp_path) as store:
        store.require_same_inputs({"arm.yaml": "1"})
        store.add(CASE, ROW)
    with SweepStore(tmp_path, restart=True) as store:
        assert store.rows() == {CASE.key: ROW}
        store.clear()
        store.require_same_inputs({"arm.yaml": "2"})
        assert store.rows() == {}


def test_two_sweeps_do_not_write_to_one_folder(tmp_path: Path) -> None:
    with SweepStore(tmp_path), pytest.raises(CommandFailedError, match="another sweep"):
        SweepStore(tmp_path)
    with SweepStore(tmp_path):
        pass


def test_results_of_changed_inputs_are_not_continued(tmp_path: Path) -> None:
    with SweepStore(tmp_path) as store:
        store.require_same_inputs({"arm.yaml": "1", "arm.xml": "1"})
        store.require_same_inputs({"arm.yaml": "2", "arm.xml": "1"})  # no result was lost
        store.add(CASE, ROW)
        store.require_same_inputs({"arm.yaml": "2", "another_test.py": "1"})
        with pytest.raises(MisuseError, match=r"arm\.yaml changed") as error:
            store.require_same_inputs({"arm.yaml": "3", "arm.xml": "1"})
        assert "--restart" in (error.value.help or "")


def test_files_that_cases_read_are_inputs_with_their_first_hash(tmp_path: Path) -> None:
    with SweepStore(tmp_path) as store:
        store.require_same_inputs({"arm.yaml": "1"})
        store.add_inputs({"table.csv": "1", "arm.yaml": "2"})
        store.add_inputs({"table.csv": "2"})
        store.add(CASE, ROW)
        assert store.inputs() == ("arm.yaml", "table.csv")
        store.require_same_inputs({"arm.yaml": "1", "table.csv": "1"})
        with pytest.raises(MisuseError, match=r"table\.csv changed"):
            store.require_same_inputs({"arm.yaml": "1", "table.csv": "2"})


def test_a_folder_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CommandFailedError):
        SweepStore(tmp_path / "file" / "out")


def test_a_file_that_is_no_database_is_reported(tmp_path: Path) -> None:
    (tmp_path / "sweep.sqlite").write_text("no database " * 100)
    with pytest.raises(CommandFailedError, match="cannot be used"):
        SweepStore(tmp_path)
    with SweepStore(tmp_path, restart=True):
        pass


def test_hashes_are_of_contents_and_by_short_names(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("1")
    (tmp_path / "b.py").write_text("1")
    hashes = hashes_of([tmp_path / "a.py", tmp_path / "b.py", tmp_path / "none.py"], tmp_path)
    assert hashes.keys() == {"a.py", "b.py"}
    assert hashes["a.py"] == hashes["b.py"]
    assert installed_sources() == installed_sources()
