"""The `obk lifecycle`, `ps`, `stop`, `logs` and `reap` commands."""

import json
import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from obk_cli.cli import stop
from obk_cli.cli.main import main
from obk_cli.introspect import lifecycle
from obk_cli.launch.events import StopRequested
from obk_cli.process.identity import this_process
from obk_cli.runs import orphans as leftovers
from obk_cli.runs import registry

from ....turns import turn_of_leftovers  # noqa: TID252 - shared by folders of tests
from ....waiting import DEADLINE_S  # noqa: TID252
from .fake_stack import CONTROL, JOY, ROBOT, fake_stack

STATES = {ROBOT: "active", CONTROL: "inactive", JOY: ""}
PID, STARTED = this_process()


@pytest.fixture
def parent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("OBK_HOME", str(tmp_path))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    # The launcher is this process, which continues.
    monkeypatch.setattr(registry, "EXIT_S", 0.0)
    # Orphans of other stacks on this host are neither shown nor killed.
    monkeypatch.setattr(leftovers, "_own_processes", psutil.Process().children)
    return tmp_path / "runs"


def obk(*arguments: str) -> int | str | None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    return ended.value.code


def test_get_shows_nodes_and_states(parent: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with fake_stack(parent, STATES):
        assert obk("lifecycle", "get") == 0
        assert capsys.readouterr().out == f"{ROBOT}    active\n{CONTROL}  inactive\n"
        assert obk("lifecycle", "get", "control_0", "--format", "json") == 0
        assert json.loads(capsys.readouterr().out) == {CONTROL: "inactive"}


def test_an_unknown_state_fails(parent: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with fake_stack(parent, {ROBOT: "unknown", CONTROL: "active"}) as stack:
        assert obk("lifecycle", "get") == 1
        stack.states[ROBOT] = "gone"
        assert obk("lifecycle", "get") == 1
        stack.states[ROBOT] = "active"
        stack.hung.add(CONTROL)
        assert obk("lifecycle", "get") == 1
    assert f"{CONTROL}  no answer" in capsys.readouterr().out


def test_list_shows_the_possible_transitions(
    parent: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with fake_stack(parent, {ROBOT: "finalized", CONTROL: "inactive"}):
        assert obk("lifecycle", "list") == 0
        assert capsys.readouterr().out == (
            f"{ROBOT}    finalized     none (final state)\n"
            f"{CONTROL}  inactive      activate, cleanup, shutdown\n"
        )
        assert obk("lifecycle", "list", "robot", "--format", "json") == 0
    reported = json.loads(capsys.readouterr().out)
    assert reported == {ROBOT: {"state": "finalized", "transitions": []}}


def test_a_change_shows_each_member(parent: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with fake_stack(parent, STATES):
        assert obk("lifecycle", "activate") == 0
        assert capsys.readouterr().out == f"{ROBOT}    active\n{CONTROL}  active\n"
        assert obk("lifecycle", "deactivate", "control", "--format", "json") == 0
    assert json.loads(capsys.readouterr().out) == {
        "success": True,
        "why": "",
        "members": [{"node": CONTROL, "result": "reached", "state": "inactive", "fault": ""}],
    }


def test_the_cause_comes_first(parent: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with fake_stack(parent, STATES) as stack:
        stack.broken.add(CONTROL)
        assert obk("lifecycle", "activate") == 1
    out, err = capsys.readouterr()
    assert err == f"error: {CONTROL}: no torque\n"
    assert out == (
        f"{CONTROL}  inactive  refused\n"
        "    on_activate: no torque\n"
        "    Traceback (most recent call last):\n"
        f"{ROBOT}    active\n"
    )


@pytest.mark.parametrize(
    ("arguments", "output"),
    [
        (("lifecycle", "activte"), "did you mean `activate`"),
        (("lifecycle", "get", "--format", "xml"), "expected `text` or `json`"),
        (
            ("lifecycle", "get", "--timeout", "0"),
            "`--timeout 0`: expected a number of seconds above 0",
        ),
        (("ps", "--format", "xml"), "expected `text` or `json`"),
        (("stop", "dummy", "--all"), "not both"),
        (("stop", "--timeout", "-1"), "`--timeout -1`: expected a number of seconds above 0"),
        (("logs", "--lines", "-1"), "at least 0"),
    ],
)
def test_misuse(
    parent: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], output: str
) -> None:
    assert obk(*arguments) == 2
    assert output in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["lifecycle", "ps", "stop", "logs", "reap"])
def test_every_command_has_help_with_an_example(
    capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    assert obk(verb, "--help") == 0
    assert f"Example: obk {verb}" in capsys.readouterr().out


def test_ros_is_not_used_if_the_launcher_replies(parent: Path) -> None:
    code = (
        "import sys\n"
        "from obk_cli.cli.main import main\n"
        "try: main(['lifecycle', 'get'])\n"
        "except SystemExit as ended: print(ended.code, 'rclpy' in sys.modules)\n"
    )
    with fake_stack(parent, STATES):
        result = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
    assert result.stdout.splitlines()[-1] == "0 False"


def test_a_launcher_that_dies_before_it_replies_is_reported(
    parent: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lifecycle, "ask_change", lambda *_, **__: None)
    with fake_stack(parent, STATES):
        assert obk("lifecycle", "activate") == 1
    assert f"the launcher of `dummy` (process {PID}) did not answer" in capsys.readouterr().err


def test_ps_as_json(parent: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with fake_stack(parent, STATES, devices=("onboard",)) as stack:
        assert obk("ps", "--format", "json") == 0
    (shown,) = json.loads(capsys.readouterr().out)["stacks"]
    assert (shown["name"], shown["domain"], shown["launcher"], shown["uptime_s"]) == (
        "dummy",
        7,
        PID,
        3723,
    )
    assert shown["run"] == stack.folder.name
    assert [(n["node"], n["pid"], n["restarts"]) for n in shown["nodes"]][1] == (CONTROL, 1234, 2)


def test_stop_ends_the_only_stack(parent: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with fake_stack(parent, STATES) as stack:
        assert obk("stop") == 0
        assert capsys.readouterr().out == "dummy: ended\n"
        assert stack.received == [StopRequested(reason="requested by `obk stop`")]
        assert obk("stop") == 1
    assert capsys.readouterr().err.startswith("error: no stack is running on this host")


def test_stop_requires_a_choice(parent: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = {"/left/obelisk_control_1": "inactive"}
    with fake_stack(parent, STATES) as dummy, fake_stack(parent, other, name="left") as left:
        assert obk("stop") == 2
        assert "several stacks are running on this host: dummy, left" in capsys.readouterr().err
        assert obk("stop", "lft") == 1
        assert "did you mean `left`?" in capsys.readouterr().err
        assert obk("stop", left.folder.name) == 0
        assert (len(dummy.received), len(left.received)) == (0, 1)
        assert obk("stop", "--all") == 0
        assert len(dummy.received) == 1
        assert obk("stop", "--all") == 0


def test_two_stacks_of_one_name_are_reported_apart_by_their_folders(
    parent: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with fake_stack(parent, STATES) as one, fake_stack(parent, STATES, domain=8) as two:
        assert obk("stop", "dummy") == 2
        names = ", ".join(sorted((one.folder.name, two.folder.name)))
        assert names in capsys.readouterr().err


def test_a_stack_that_does_not_end_is_reported(
    parent: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stop, "end_launcher", lambda *_, **__: "running")
    with fake_stack(parent, STATES):
        assert obk("stop", "--timeout", "2") == 1
    assert capsys.readouterr().err == (
        f"error: dummy (launcher {PID}) did not stop within 2 s; use `--kill` to kill it\n"
    )


def test_logs_show_the_most_recent_run_and_its_nodes(
    parent: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with fake_stack(parent, STATES) as stack:
        (stack.folder / "launch.log").write_text("one\ntwo\n")
        (stack.folder / "obelisk_control_0.log").write_text("\x1b[31mred\x1b[0m\x1b[2J\n")
        assert obk("logs") == 0
        assert capsys.readouterr().out == "one\ntwo\n"
        assert obk("logs", "dummy", "-n", "1") == 0
        assert capsys.readouterr().out == "two\n"
        assert obk("logs", "control_0") == 0
        assert capsys.readouterr().out == "red\n"
        assert obk("logs", "control_0", "--color", "always") == 0
        assert capsys.readouterr().out == "\x1b[31mred\x1b[0m\n"
        assert obk("logs", "robot_0") == 0
        assert "does not exist" in capsys.readouterr().err


def test_reap_ends_orphans_and_reports_them(
    parent: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    marks = {"OBK_RUN": f"reaped_{os.getpid()}", "OBK_LAUNCHER": f"{PID}:{STARTED - 60}"}
    wait = "import sys; print(flush=True); sys.stdin.read()"
    with (
        turn_of_leftovers(),
        subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", wait],
            env=marks,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        ) as left,
    ):
        assert left.stdout is not None
        left.stdout.readline()
        line = f"{left.pid}  {marks['OBK_RUN']}  {sys.executable} -I"
        assert obk("ps") == 0
        assert f"  {line}" in capsys.readouterr().out
        assert obk("reap", "--dry-run") == 0
        assert line in capsys.readouterr().out
        assert left.poll() is None
        assert obk("reap") == 0
        assert line in capsys.readouterr().out
        assert left.wait(DEADLINE_S) == -15
