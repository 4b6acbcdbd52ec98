"""What stays of a run that was claimed and could not begin."""

import json
from pathlib import Path
from typing import Any, Final, cast

import pytest

from obk_cli.adapters.ros_environment import RosEnvironment
from obk_cli.errors import CommandFailedError
from obk_cli.launch.devices import Share
from obk_cli.plan.plan import Plan
from obk_cli.report.launch import LaunchReport
from obk_cli.running.claim import claimed
from obk_cli.running.options import LaunchOptions
from obk_cli.running.output import Output

from ..plans import node  # noqa: TID252 - shared by folders of tests
from .shown import Shown

PLAN: Final = Plan(name="s", processes=(node("a"),))
OPTIONS: Final = LaunchOptions(
    config="c.yaml", folder=Path(), share=Share(devices=frozenset({"onboard"}), is_part=False)
)


def test_why_a_run_could_not_begin_stands_in_its_folder(tmp_path: Path) -> None:
    variables = {"OBK_HOME": str(tmp_path), "ROS_DOMAIN_ID": "7"}
    environment = RosEnvironment(variables=variables, range="LOCALHOST", notes=())
    voice = LaunchReport((), colour=False, quiet=False)
    with (
        pytest.raises(CommandFailedError),
        claimed(PLAN, environment, OPTIONS) as claim,
        Output(claim.folder, Shown(), voice, ()),
    ):
        raise CommandFailedError("somebody else moves the robot", help="end that")
    (folder,) = (tmp_path / "runs").glob("s_*")
    told = cast(dict[str, Any], json.loads((folder / "run.json").read_text()))
    assert (told["exit_code"], told["cause"]) == (1, "somebody else moves the robot")
    assert told["ended"] is not None
    assert (folder / "launch.log").read_text() == "failed: somebody else moves the robot\n"
