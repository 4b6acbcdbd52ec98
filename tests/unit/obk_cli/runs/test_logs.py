"""The log that arguments refer to."""

from datetime import datetime
from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.runs.folder import Run, make_run_folder, write_run
from obk_cli.runs.logs import find_log

NODES = ("/obelisk_robot_0", "/obelisk_control_0", "/left/obelisk_control_1")


@pytest.fixture
def folders(tmp_path: Path) -> list[Path]:
    """Two runs of one config, and a newer one of another."""
    made = []
    for year, name in ((2031, "dummy"), (2032, "dummy"), (2033, "other")):
        folder = make_run_folder(tmp_path, name, datetime(year, 2, 3))
        run = Run(name=name, pid=1, started=1.0, domain=1, config="c", nodes=NODES)
        write_run(folder, run)
        made.append(folder)
    return made


def test_the_most_recent_run_is_the_default(tmp_path: Path, folders: list[Path]) -> None:
    old, new, other = folders
    assert find_log(tmp_path, None, None) == other / "launch.log"
    assert find_log(tmp_path, "dummy", None) == new / "launch.log"
    assert find_log(tmp_path, old.name, None) == old / "launch.log"
    assert find_log(tmp_path, "dummy~0", None) == new / "launch.log"
    assert find_log(tmp_path, "dummy~1", "control_0") == old / "obelisk_control_0.log"
    with pytest.raises(CommandFailedError, match="only 2 runs"):
        find_log(tmp_path, "dummy~2", None)


def test_a_node_is_named_in_full_or_in_short(tmp_path: Path, folders: list[Path]) -> None:
    _, new, other = folders
    assert find_log(tmp_path, "dummy", "control_0") == new / "obelisk_control_0.log"
    assert find_log(tmp_path, "dummy", NODES[2]) == new / "left.obelisk_control_1.log"
    assert find_log(tmp_path, "control_1", None) == other / "left.obelisk_control_1.log"


def test_a_log_of_a_run_that_reports_nothing_is_found(tmp_path: Path) -> None:
    folder = make_run_folder(tmp_path, "dummy", datetime(2031, 2, 3))
    (folder / "obelisk_robot_0.log").write_text("")
    assert find_log(tmp_path, "dummy", "robot_0") == folder / "obelisk_robot_0.log"


@pytest.mark.parametrize(
    ("names", "message", "help"),
    [
        (
            ("dumy", None),
            "no run, and no node of the latest run, has the name `dumy`",
            "did you mean `dummy`?",
        ),
        (("contrl_0", "robot_0"), "no run has the name `contrl_0`", "available: `other`, `dumm"),
        (("dummy", "robo_0"), r"the run dummy_\d+_\d+ has no node `robo_0`", "did you mean `robot"),
        (("dummy", "control"), "`control` is ambiguous", "choose one of `control_0`, `left/"),
    ],
)
def test_a_missing_name_is_reported_with_the_existing_ones(
    tmp_path: Path, folders: list[Path], names: tuple[str, str | None], message: str, help: str
) -> None:
    with pytest.raises(CommandFailedError, match=message) as raised:
        find_log(tmp_path, *names)
    assert raised.value.help is not None
    assert raised.value.help.startswith(help)


def test_without_runs(tmp_path: Path) -> None:
    with pytest.raises(CommandFailedError, match="no runs in"):
        find_log(tmp_path / "none", None, None)
