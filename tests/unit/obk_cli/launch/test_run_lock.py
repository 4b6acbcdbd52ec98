"""The lock of a run: only one launch may use the names of nodes, and leftovers of others."""

import errno
import fcntl
import hashlib
import json
import signal
import subprocess
import sys
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final, cast

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.launch import run_lock
from obk_cli.launch.console import Output
from obk_cli.launch.event_lines import LaunchReport
from obk_cli.launch.options import KEPT_RUNS, LaunchOptions
from obk_cli.launch.process_groups import Share
from obk_cli.launch.run_lock import claim_run, locked_run
from obk_cli.plan.plan import Plan
from obk_cli.process.identity import boot_id, start_s, this_process
from obk_cli.record.recorder_job import RecordRequest
from obk_cli.ros.environment import RosEnvironment
from obk_cli.runs.folder import Run, RunOrigin, make_run_folder, read_run, run_folders, write_run
from obk_cli.runs.registry import is_alive, live_runs

from ....waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests
from ..plans import node  # noqa: TID252 - shared by folders of tests
from .shown import Shown

NOW = datetime(2031, 2, 3, 4, 5, 6)
PID, STARTED = this_process()
RUN = Run(
    name="s",
    pid=PID,
    started=STARTED,
    domain=80,
    config="c.yaml",
    nodes=("/a", "/b"),
    boot=boot_id(),
)
OTHER_NODES = replace(RUN, name="t", nodes=("/c",))


def test_a_claim_is_visible_to_other_terminals(tmp_path: Path) -> None:
    folder = claim_run(tmp_path, RUN, NOW)
    assert read_run(folder) == RUN
    assert live_runs(tmp_path) == (RUN,)


@pytest.mark.parametrize(
    "second", [replace(OTHER_NODES, name="s"), replace(RUN, name="t", nodes=("/b", "/c"))]
)
def test_the_same_name_or_a_common_node_is_rejected(tmp_path: Path, second: Run) -> None:
    claim_run(tmp_path, RUN, NOW)
    message = rf"the stack `s` is already running in ROS domain 80 \(process {PID}, .*/b\)"
    with pytest.raises(CommandFailedError, match=message) as raised:
        claim_run(tmp_path, second, NOW)
    assert raised.value.help == "stop it or use another ROS_DOMAIN_ID"
    assert len(run_folders(tmp_path)) == 1


ONE_DEVICE = replace(RUN, devices=("onboard",))
OTHER_DEVICE = replace(RUN, devices=("offboard",), nodes=("/c",))


def test_two_devices_of_one_config_run_side_by_side(tmp_path: Path) -> None:
    claim_run(tmp_path, ONE_DEVICE, NOW)
    claim_run(tmp_path, OTHER_DEVICE, NOW)
    assert set(live_runs(tmp_path)) == {ONE_DEVICE, OTHER_DEVICE}


@pytest.mark.parametrize(
    "second",
    [
        replace(OTHER_DEVICE, devices=("offboard", "onboard")),
        replace(OTHER_DEVICE, devices=()),
        replace(OTHER_DEVICE, nodes=("/a",)),
    ],
)
def test_a_device_or_a_node_runs_once(tmp_path: Path, second: Run) -> None:
    claim_run(tmp_path, ONE_DEVICE, NOW)
    with pytest.raises(CommandFailedError, match="is already running"):
        claim_run(tmp_path, second, NOW)


@pytest.mark.parametrize("second", [OTHER_NODES, replace(RUN, domain=81)])
def test_other_nodes_and_other_domains_run_side_by_side(tmp_path: Path, second: Run) -> None:
    claim_run(tmp_path, RUN, NOW)
    claim_run(tmp_path, second, NOW)
    assert set(live_runs(tmp_path)) == {RUN, second}


def test_a_node_without_a_lifecycle_counts_too(tmp_path: Path) -> None:
    claim_run(tmp_path, replace(RUN, other_nodes=("/joy",)), NOW)
    with pytest.raises(CommandFailedError, match="/joy"):
        claim_run(tmp_path, replace(OTHER_NODES, other_nodes=("/joy",)), NOW)


def test_a_run_that_has_ended_does_not_block(tmp_path: Path) -> None:
    folder = claim_run(tmp_path, RUN, NOW)
    write_run(folder, replace(RUN, ended=1.0))
    claim_run(tmp_path, RUN, NOW)


def test_an_ended_or_reused_process_id_is_not_alive() -> None:
    assert is_alive(RUN)
    assert not is_alive(replace(RUN, started=STARTED - 60))
    assert not is_alive(replace(RUN, boot="another start of the machine, or another machine"))
    with subprocess.Popen([sys.executable, "-I", "-S", "-c", ""]) as ended:
        ended.wait()
    assert not is_alive(replace(RUN, pid=ended.pid))


def test_two_simultaneous_claims_do_not_both_succeed(tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "from dataclasses import replace\n"
        "from datetime import datetime\n"
        "from pathlib import Path\n"
        "from obk_cli.launch.run_lock import claim_run\n"
        "from obk_cli.process.identity import this_process\n"
        "from obk_cli.runs.folder import Run\n"
        "pid, started = this_process()\n"
        "run = Run(name='s', pid=pid, started=started, domain=1, config='c', nodes=('/a',))\n"
        "print(flush=True); sys.stdin.readline()\n"
        "try: claim_run(Path(sys.argv[1]), run, datetime(2031, 2, 3))\n"
        "except Exception as error: print(error, flush=True)\n"
        "else: print('claimed', flush=True)\n"
        "sys.stdin.readline()\n"
    )
    racers = [
        subprocess.Popen(
            [sys.executable, "-c", code, str(tmp_path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(3)
    ]
    for racer in racers:
        assert racer.stdout is not None
        racer.stdout.readline()
    for racer in racers:
        assert racer.stdin is not None
        racer.stdin.write("\n")
        racer.stdin.flush()
    output = [racer.stdout.readline().strip() for racer in racers if racer.stdout]
    for racer in racers:
        racer.communicate("\n")
    assert output.count("claimed") == 1
    assert sum("is already running in ROS domain 1" in line for line in output) == 2


def test_the_oldest_runs_are_removed_but_never_live_ones(tmp_path: Path) -> None:
    live = claim_run(tmp_path, RUN, NOW.replace(year=2000))
    for minute in range(KEPT_RUNS + 1):
        write_run(
            make_run_folder(tmp_path, "s", NOW.replace(minute=minute)), replace(RUN, ended=1.0)
        )
    (tmp_path / "notes").mkdir()
    newest = claim_run(tmp_path, OTHER_NODES, NOW.replace(year=2040))
    folders = run_folders(tmp_path)
    assert len(folders) == KEPT_RUNS + 1
    assert folders[0] == newest
    assert folders[-1] == live
    assert (tmp_path / "notes").is_dir()


def test_the_requested_number_of_runs_is_kept(tmp_path: Path) -> None:
    for minute in range(3):
        write_run(
            make_run_folder(tmp_path, "s", NOW.replace(minute=minute)), replace(RUN, ended=1.0)
        )
    recorded = run_folders(tmp_path)[-1]
    (recorded / "recording.mcap").touch()
    newest = claim_run(tmp_path, RUN, NOW.replace(year=2040), keep=2)
    folders = run_folders(tmp_path)
    assert (folders[0], folders[-1]) == (newest, recorded)
    assert len(folders) == 3


def test_a_claim_stores_the_config_of_the_run(tmp_path: Path) -> None:
    made_from = RunOrigin(plan='{"name": "s", "processes": []}\n', versions={"obk": "1"})
    reported = json.loads(
        (claim_run(tmp_path, RUN, NOW, made_from=made_from) / "run.json").read_text()
    )
    assert reported["plan"] == {"name": "s", "processes": []}
    assert reported["plan_sha256"] == hashlib.sha256(made_from.plan.encode()).hexdigest()
    assert reported["versions"] == {"obk": "1"}


def test_a_disk_that_takes_a_folder_and_no_file_is_left_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(folder: Path, *_: object) -> None:
        (folder / ".run.json").touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(run_lock, "write_run", full)
    with pytest.raises(OSError, match="No space"):
        claim_run(tmp_path, RUN, NOW)
    assert run_folders(tmp_path) == ()


def test_a_replacing_launch_ends_the_other_launcher_first(tmp_path: Path) -> None:
    code = "import time; print('up', flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as other:
        started = start_s(other.pid)
        assert started is not None
        assert other.stdout is not None
        other.stdout.readline()  # While Python is starting, SIGINT stops it in a different way.
        claim_run(tmp_path, replace(RUN, pid=other.pid, started=started), NOW)
        folder = claim_run(tmp_path, RUN, NOW, replace_other=True)
        assert other.wait(DEADLINE_S) == -signal.SIGINT
    assert read_run(folder) == RUN


@pytest.mark.parametrize(
    ("end", "sentence"),
    [
        (
            "running",
            rf"the stack `s` in ROS domain 80 did not stop \(process {PID}\)",
        ),
        ("ended", "another process keeps restarting the stack `s`"),
    ],
    ids=("running", "another one by then"),  # the process ID differs between workers
)
def test_a_launch_that_cannot_replace_another_reports_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str, sentence: str
) -> None:
    claim_run(tmp_path, RUN, NOW)
    monkeypatch.setattr(run_lock, "end_launcher", lambda *_, **__: end)
    with pytest.raises(CommandFailedError, match=sentence):
        claim_run(tmp_path, RUN, NOW, replace_other=True)
    assert len(run_folders(tmp_path)) == 1


def test_a_claim_in_use_is_not_waited_for_endlessly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_lock, "CLAIM_S", 0.0)
    path = tmp_path / ".domain_80.lock"
    with path.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(CommandFailedError) as raised:
            claim_run(tmp_path, RUN, NOW)
    assert raised.value.message == f"another process has held {path} for 0 s"
    assert raised.value.help == "stop any `obk launch` that is suspended or hangs"
    claim_run(tmp_path, RUN, NOW)


PLAN: Final = Plan(name="s", nodes=(node("a"),))
OPTIONS: Final = LaunchOptions(
    config="c.yaml", folder=Path(), share=Share(devices=frozenset({"onboard"}), is_part=False)
)


def test_the_reason_why_a_run_could_not_start_is_in_its_folder(tmp_path: Path) -> None:
    variables = {"OBK_HOME": str(tmp_path), "ROS_DOMAIN_ID": "7"}
    environment = RosEnvironment(variables=variables, range="LOCALHOST", notes=())
    voice = LaunchReport((), colour=False, quiet=False)
    with (
        pytest.raises(CommandFailedError),
        locked_run(PLAN, environment, OPTIONS) as lock,
        Output(lock.folder, Shown(), voice, ()),
    ):
        raise CommandFailedError("another node moves the robot", help="end that")
    (folder,) = (tmp_path / "runs").glob("s_*")
    reported = cast(dict[str, Any], json.loads((folder / "run.json").read_text()))
    assert (reported["exit_code"], reported["cause"]) == (1, "another node moves the robot")
    assert reported["ended"] is not None
    assert (folder / "launch.log").read_text() == "failed: another node moves the robot\n"


def test_a_run_without_a_folder_warns_of_what_follows(tmp_path: Path) -> None:
    (tmp_path / "runs").touch()
    environment = RosEnvironment(variables={"OBK_HOME": str(tmp_path)}, range="LOCALHOST", notes=())
    shown = Shown()
    with (
        locked_run(PLAN, environment, OPTIONS) as lock,
        Output(lock.folder, shown, LaunchReport((), colour=False, quiet=False), ()) as output,
    ):
        lock.report(output)
    assert lock.folder is None
    assert "OBK_HOME" in str(shown.lines)


def test_a_run_without_a_folder_is_not_recorded_silently(tmp_path: Path) -> None:
    (tmp_path / "runs").touch()
    environment = RosEnvironment(variables={"OBK_HOME": str(tmp_path)}, range="LOCALHOST", notes=())
    options = replace(OPTIONS, recording=RecordRequest())
    with pytest.raises(CommandFailedError) as raised, locked_run(PLAN, environment, options):
        pass
    assert "OBK_HOME" in str(raised.value.help)
