"""Incompatible options of `obk launch`, and the resulting limits."""

import subprocess
import sys
from pathlib import Path

import pytest

from obk_cli.cli.launch_plan import limits_for
from obk_cli.cli.main import main

DUMMY = Path(__file__).parents[4] / "examples" / "dummy" / "dummy.yaml"


def test_a_lead_without_a_single_device_is_misuse(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(("launch", str(DUMMY), "--lead", "onboard"))
    assert ended.value.code == 2
    assert capsys.readouterr().err == (
        "error: `--lead` needs `--device`: it names the device whose launch leads\n"
    )


def test_a_generous_transition_limit_extends_the_start_limit() -> None:
    assert (limits_for(10.0, 1.3).transition_s, limits_for(10.0, 1.3).start_s) == (10.0, 20.0)
    assert (limits_for(60.0, 1.3).transition_s, limits_for(60.0, 1.3).start_s) == (60.0, 60.0)
    assert [limits_for(limit_s, 1.3).down_s for limit_s in (1.0, 10.0, 20.0)] == [3.0, 3.0, 20.0]


def test_an_answer_may_be_waited_for_without_end() -> None:
    assert limits_for(10.0, 0.0).hang_s == float("inf")
    assert limits_for(10.0, 2.0).hang_s == 2.0


def test_the_preload_server_need_not_wait_for_the_import_of_the_compiler() -> None:
    program = "import sys, obk_cli.cli.launch; print('obk_cli.compiler' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "False\n"
