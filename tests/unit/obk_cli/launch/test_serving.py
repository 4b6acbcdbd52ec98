"""A run that cannot answer other terminals runs all the same."""

from contextlib import ExitStack
from pathlib import Path
from queue import SimpleQueue

from obk_cli.launch.console import Output
from obk_cli.launch.events import InputEvent
from obk_cli.launch.run import _serve_others
from obk_cli.report.launch import LaunchReport

from .shown import Shown


class Ros:
    """The door to ROS, which nobody goes through."""

    def look(self) -> None:
        return None


def test_a_socket_that_cannot_be_is_told_and_no_more(tmp_path: Path) -> None:
    (tmp_path / "control.sock").write_text("in the way")
    screen = Shown()
    inbox: SimpleQueue[InputEvent] = SimpleQueue()
    output = Output(None, screen, LaunchReport((), colour=False, quiet=False), ())
    with ExitStack() as stack:
        _serve_others(tmp_path, Ros(), inbox, output, stack)  # type: ignore[arg-type]
    (line,) = screen.lines
    assert line.startswith("warning: other terminals are not answered: ")


def test_what_the_launcher_says_besides_stands_in_the_runs_log_too(tmp_path: Path) -> None:
    output = Output(tmp_path, Shown(), LaunchReport((), colour=True, quiet=False), ())
    with output:
        output.note("warning: nothing is recorded: there is no folder for it")
    assert (tmp_path / "launch.log").read_text() == (
        "warning: nothing is recorded: there is no folder for it\n"
    )
