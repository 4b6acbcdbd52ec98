"""Where a run's parameters go."""

from contextlib import ExitStack
from pathlib import Path

import pytest

from obk_cli.adapters.screen import Screen
from obk_cli.plan import Origin, Plan, Process
from obk_cli.report.launch import LaunchReport
from obk_cli.running import _Output, _write_params

PROCESS = Process(
    node="obelisk_control_0",
    namespace="/",
    section="control",
    device="onboard",
    package="p",
    executable="e",
    origin=Origin(path="c.yaml", line=1, column=1),
    parameters={"a": 1},
)
PLAN = Plan(name="s", processes=(PROCESS,))


class Shown(Screen):
    """A screen that keeps its lines."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def put(self, line: str, *, may_drop: bool = False) -> None:
        self.lines.append(line)


@pytest.mark.parametrize("is_there", [True, False])
def test_parameters_that_the_run_folder_does_not_take_go_to_one_that_goes_at_the_end(
    tmp_path: Path, is_there: bool
) -> None:
    (tmp_path / "params").write_text("a file where the folder would be")
    screen = Shown()
    output = _Output(None, screen, LaunchReport((), colour=False, quiet=False))
    with ExitStack() as stack:
        files = _write_params(PLAN, tmp_path if is_there else None, output, stack)
        assert '"a": 1' in files[PROCESS.full_name].read_text()
    assert not files[PROCESS.full_name].exists()
    assert [line.split(":")[0] for line in screen.lines] == ["warning"] * is_there
