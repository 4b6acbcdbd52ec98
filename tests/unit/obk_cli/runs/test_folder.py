"""Run folders."""

import json
import os
from dataclasses import asdict, replace
from datetime import datetime
from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.runs.folder import (
    Run,
    RunOrigin,
    make_run_folder,
    read_run,
    record_end,
    run_folders,
    runs_folder,
    write_run,
)

NOW = datetime(2031, 2, 3, 4, 5, 6)
RUN = Run(name="dummy", pid=1, started=2.5, domain=3, config="c.yaml", nodes=("/a", "/b"))


def test_the_folder_carries_the_configs_name_and_the_time(tmp_path: Path) -> None:
    folder = make_run_folder(tmp_path / "runs", "dummy", NOW)
    assert folder.name == "dummy_20310203_040506"


def test_runs_are_private_to_their_owner_with_any_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        folder = make_run_folder(tmp_path / "home" / "runs", "dummy", NOW)
    finally:
        os.umask(before)
    assert [f.stat().st_mode & 0o777 for f in (folder, folder.parent)] == [0o700, 0o700]


def test_two_runs_of_one_second_have_two_folders(tmp_path: Path) -> None:
    first, second = (make_run_folder(tmp_path, "dummy", NOW) for _ in range(2))
    assert first != second


def test_the_last_of_a_hundred_runs_in_one_second_is_rejected_with_the_reason(
    tmp_path: Path,
) -> None:
    for _ in range(99):
        make_run_folder(tmp_path, "dummy", NOW)
    output = r"dummy_20310203_040506: 99 runs were started within this second"
    with pytest.raises(FileExistsError, match=output):
        make_run_folder(tmp_path, "dummy", NOW)


def test_a_run_is_read_back(tmp_path: Path) -> None:
    folder = make_run_folder(tmp_path, "dummy", NOW)
    write_run(folder, RUN)
    assert read_run(folder) == RUN
    assert [path.name for path in folder.iterdir()] == ["run.json"]


def test_a_run_of_a_very_long_name_has_a_folder(tmp_path: Path) -> None:
    folder = make_run_folder(tmp_path, "é" * 300, NOW)
    assert folder.name == "é" * 100 + "_20310203_040506"
    assert run_folders(tmp_path) == (folder,)


def test_a_run_whose_config_has_a_path_that_is_not_utf_8_is_read_back(tmp_path: Path) -> None:
    run = replace(RUN, config="caf\udce9.yaml")
    write_run(tmp_path, run)
    assert read_run(tmp_path) == run


def test_runs_that_cannot_be_read_are_left_out(tmp_path: Path) -> None:
    for second, text in enumerate(("{", "[]", '{"pid": 1}')):
        folder = make_run_folder(tmp_path, "dummy", NOW.replace(second=second))
        (folder / "run.json").write_text(text)
        assert read_run(folder) is None


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *(("pid", "1"), ("started", "2"), ("domain", None), ("nodes", [1]), ("nodes", "/a")),
        *(("name", "a\x1b[2J"), ("name", "\ud800"), ("started", 10**400)),
    ],
)
def test_a_run_of_another_shape_is_left_out(tmp_path: Path, field: str, value: object) -> None:
    folder = make_run_folder(tmp_path, "dummy", NOW)
    (folder / "run.json").write_text(json.dumps({**asdict(RUN), field: value}))
    assert read_run(folder) is None


def test_an_invalid_run_file_is_not_waited_for(tmp_path: Path) -> None:
    pipe, device, long = (make_run_folder(tmp_path, name, NOW) for name in "abc")
    os.mkfifo(pipe / "run.json")
    (device / "run.json").symlink_to("/dev/zero")
    with (long / "run.json").open("wb") as file:
        file.truncate(1 << 40)
    assert [read_run(folder) for folder in (pipe, device, long)] == [None] * 3


def test_obk_home_moves_the_runs(tmp_path: Path) -> None:
    assert runs_folder({"OBK_HOME": str(tmp_path)}) == tmp_path / "runs"


def test_runs_are_listed_newest_first_whatever_their_names(tmp_path: Path) -> None:
    old = make_run_folder(tmp_path, "zebra", NOW)
    same_second = make_run_folder(tmp_path, "zebra", NOW)
    new = make_run_folder(tmp_path, "ant", NOW.replace(year=2032))
    (tmp_path / "notes").mkdir()
    assert run_folders(tmp_path) == (new, same_second, old)


def test_ros_log_dir_contains_the_runs_if_obk_home_does_not(tmp_path: Path) -> None:
    logs = {"ROS_LOG_DIR": str(tmp_path)}
    assert runs_folder(logs) == tmp_path / "obk" / "runs"
    assert runs_folder({**logs, "OBK_HOME": "/home"}) == Path("/home/runs")


def test_an_unreadable_folder_has_no_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_run_folder(tmp_path, "dummy", NOW)

    def refused(*_: object) -> None:
        raise PermissionError("Permission denied")

    monkeypatch.setattr(Path, "glob", refused)
    assert run_folders(tmp_path) == ()


def test_a_user_without_a_home_gets_a_hint(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HOME", "XDG_STATE_HOME"):
        monkeypatch.delenv(name, raising=False)

    def unknown(_: int) -> None:
        raise KeyError("no such user")

    monkeypatch.setattr("pwd.getpwuid", unknown)
    with pytest.raises(CommandFailedError, match="this user has no home") as refused:
        runs_folder({})
    assert refused.value.help == "set HOME, or OBK_HOME"


def test_the_outcome_is_stored_next_to_the_config_of_the_run(tmp_path: Path) -> None:
    write_run(tmp_path, RUN, RunOrigin(plan='{"name": "dummy"}', versions={"obk": "1"}))
    record_end(tmp_path, RUN, 7.0, exit_code=1, cause="a node crashed")
    assert read_run(tmp_path) == replace(RUN, ended=7.0, exit_code=1, cause="a node crashed")
    reported = json.loads((tmp_path / "run.json").read_text())
    assert (reported["plan"], reported["versions"]) == ({"name": "dummy"}, {"obk": "1"})


def test_a_run_of_a_later_version_is_read_as_far_as_it_is_known(tmp_path: Path) -> None:
    write_run(tmp_path, RUN)
    reported = json.loads((tmp_path / "run.json").read_text())
    (tmp_path / "run.json").write_text(json.dumps({**reported, "colour": "red"}))
    assert read_run(tmp_path) == RUN


def test_a_name_with_a_slash_makes_one_folder(tmp_path: Path) -> None:
    assert make_run_folder(tmp_path, "a/b", NOW).parent == tmp_path


def test_a_run_that_cannot_be_written_leaves_nothing_and_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_run_folder(tmp_path, "dummy", NOW)
    write_run(folder, RUN)
    assert (folder / "run.json").stat().st_mode & 0o777 == 0o600

    def fill_the_disk(path: Path, text: str, **_: object) -> None:
        path.write_bytes(text[:10].encode())
        raise OSError("no space left on device")

    monkeypatch.setattr(Path, "write_text", fill_the_disk)
    with pytest.raises(OSError, match="no space"):
        write_run(folder, replace(RUN, pid=2))
    assert [path.name for path in folder.iterdir()] == ["run.json"]
    assert read_run(folder) == RUN
