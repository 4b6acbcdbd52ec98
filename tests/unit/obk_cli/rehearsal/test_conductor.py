"""What a rehearsal does around its cases, with launchers that are no stacks."""

import os
import sys
from pathlib import Path

import pytest

from obk_cli.adapters.claims import claim_run
from obk_cli.adapters.clock import local_time
from obk_cli.adapters.process_start import this_process
from obk_cli.compiler import Options, compile_config
from obk_cli.errors import CommandFailedError
from obk_cli.launch.runs import Run
from obk_cli.rehearsal.conductor import Setting, rehearse
from obk_cli.rehearsal.guard import refuse_hardware, refuse_running
from obk_cli.rehearsal.home import make_home
from obk_cli.rehearsal.launched import Launched

from .stage import case

DUMMY = Path(__file__).parents[4] / "examples" / "dummy" / "dummy.yaml"


def test_a_launch_that_fails_is_told_in_its_own_words_and_tried_again(tmp_path: Path) -> None:
    refuse = "import sys; print('error: no room', file=sys.stderr); sys.exit(1)"
    setting = Setting(
        command=(sys.executable, "-c", refuse), environment=dict(os.environ), runs=tmp_path
    )
    begun: list[str] = []
    rows = rehearse(
        [case("kill", "stop"), case("freeze", "stop")], setting, lambda c: begun.append(c.fault)
    )
    assert begun == ["kill", "freeze"]
    assert [row.seen for row in rows] == ["not tried", "not tried"]
    assert rows[0].faults[0] == "the stack did not come up: error: no room"


def test_a_launcher_that_has_said_its_last_word_is_waited_for(tmp_path: Path) -> None:
    leave = "import os, time; os.close(1); os.close(2); time.sleep(0.3); os._exit(1)"
    launched = Launched((sys.executable, "-c", leave), dict(os.environ), tmp_path)
    assert not launched.wait_until(lambda _: False, 20.0)
    assert launched.over_s is not None
    assert launched.outcome(20.0) == 1
    launched.end(0.0)


def test_a_launcher_that_may_still_say_something_is_not_waited_for(tmp_path: Path) -> None:
    launched = Launched(("sleep", "60"), dict(os.environ), tmp_path)
    assert launched.outcome(20.0) is None
    launched.end(0.0)


def compiled(*overrides: str) -> Options:
    return Options(variables={}, working_folder=DUMMY.parent, overrides=overrides)


def test_a_robot_that_is_hardware_is_refused_with_its_place() -> None:
    outcome = compile_config(str(DUMMY), compiled("onboard.robot[0].is_simulated=false"))
    assert outcome.config is not None
    with pytest.raises(CommandFailedError, match="<command line>:1:1: the robot /obelisk_robot_0"):
        refuse_hardware(outcome.config)


def test_a_robot_that_is_simulated_is_not_refused() -> None:
    outcome = compile_config(str(DUMMY), compiled())
    assert outcome.config is not None
    refuse_hardware(outcome.config)


def test_a_stack_that_runs_is_refused_with_its_process(tmp_path: Path) -> None:
    pid, started = this_process()
    run = Run(name="s", pid=pid, started=started, domain=7, config="c.yaml", nodes=("/a",))
    claim_run(tmp_path, run, local_time())
    refuse_running(tmp_path, "another")
    with pytest.raises(CommandFailedError, match=rf"domain 7 \(process {pid}\)") as refused:
        refuse_running(tmp_path, "s")
    assert refused.value.help == "`obk stop s` ends it"


def test_ten_rehearsals_keep_their_logs(tmp_path: Path) -> None:
    first, *later = [make_home(tmp_path, "s") for _ in range(11)]
    assert not first.exists()
    assert all(home.exists() for home in later)


def test_where_no_logs_can_be_kept_nothing_is_rehearsed(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CommandFailedError, match="a rehearsal keeps logs, and cannot here"):
        make_home(tmp_path / "file", "s")
