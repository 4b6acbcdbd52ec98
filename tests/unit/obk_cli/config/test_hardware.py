"""Robots that are hardware, simulated, or neither by their config."""

from pathlib import Path

import pytest

from obk_cli.compiler import Options, compile_config
from obk_cli.config.model import Stack, refuse_hardware
from obk_cli.errors import CommandFailedError

DUMMY = Path(__file__).parents[4] / "examples" / "dummy" / "dummy.yaml"


def stack(*overrides: str) -> Stack:
    options = Options(variables={}, working_folder=DUMMY.parent, overrides=overrides)
    config = compile_config(str(DUMMY), options).config
    assert config is not None
    return config


@pytest.mark.parametrize("may_be_unclear", [True, False])
def test_hardware_is_rejected_with_its_location(may_be_unclear: bool) -> None:
    hardware = stack("onboard.robot[0].is_simulated=false")
    with pytest.raises(
        CommandFailedError, match=r"<command line>:1:1: .*/obelisk_robot_0 .* and it moves"
    ) as raised:
        refuse_hardware(hardware, "it moves", help="simulate", may_be_unclear=may_be_unclear)
    assert raised.value.help == "simulate"


def test_simulated_robots_are_accepted() -> None:
    refuse_hardware(stack(), "it moves", help="")
    refuse_hardware(stack("onboard.robot[0].sim=[]"), "it moves", help="")


def test_a_robot_without_a_setting_is_rejected_unless_it_may_be_unclear() -> None:
    unclear = stack("onboard.robot[0].sim=[]", "onboard.robot[0].is_simulated=null")
    refuse_hardware(unclear, "it moves", help="", may_be_unclear=True)
    with pytest.raises(CommandFailedError):
        refuse_hardware(unclear, "it moves", help="")
