"""Which config the parameters of running nodes may be written into."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from obk_cli.compiler import Options
from obk_cli.errors import CommandFailedError
from obk_cli.introspect.config_update import find_update
from obk_cli.plan.plan import Plan

from ..plans import node  # noqa: TID252 - shared by folders of tests

DUMMY = Path(__file__).parents[4] / "examples" / "dummy" / "dummy.yaml"


def test_the_config_of_another_stack_is_rejected(tmp_path: Path) -> None:
    other = node("obelisk_control_0", package="arm_py", executable="arm_controller")
    target: Any = SimpleNamespace(plans=(Plan(name="arm", nodes=(other,)),))
    with pytest.raises(CommandFailedError, match="not the config of the running stack") as caught:
        find_update(str(DUMMY), Options(variables={}, working_folder=tmp_path), target, 0.1)
    assert "arm_py/arm_controller" in str(caught.value)
