"""Run folders."""

from datetime import datetime
from pathlib import Path

from obk_cli.launch.runs import Run, make_run_folder, read_runs, runs_folder, write_run
from obk_cli.plan import Plan

NOW = datetime(2031, 2, 3, 4, 5, 6)
RUN = Run(name="dummy", pid=1, started=2.5, domain=3, config="c.yaml", nodes=("/a", "/b"))


def test_the_folder_carries_the_configs_name_and_the_time(tmp_path: Path) -> None:
    folder = make_run_folder(tmp_path / "runs", Plan(name="dummy", processes=()), NOW)
    assert folder.name == "dummy_20310203_040506"
    assert folder.stat().st_mode & 0o777 == 0o700


def test_two_runs_of_one_second_have_two_folders(tmp_path: Path) -> None:
    plan = Plan(name="dummy", processes=())
    assert make_run_folder(tmp_path, plan, NOW) != make_run_folder(tmp_path, plan, NOW)


def test_a_run_is_read_back(tmp_path: Path) -> None:
    folder = make_run_folder(tmp_path, Plan(name="dummy", processes=()), NOW)
    write_run(folder, RUN)
    assert read_runs(tmp_path) == (RUN,)
    assert [path.name for path in folder.iterdir()] == ["run.json"]


def test_runs_that_cannot_be_read_are_left_out(tmp_path: Path) -> None:
    for name, text in {"a": "{", "b": "[]", "c": '{"pid": 1}'}.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.json").write_text(text)
    assert read_runs(tmp_path) == ()


def test_obk_home_moves_the_runs(tmp_path: Path) -> None:
    assert runs_folder({"OBK_HOME": str(tmp_path)}) == tmp_path / "runs"
