"""How a run connects its parts: order of subscribers, other terminals, log."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from queue import SimpleQueue
from types import SimpleNamespace

from obk_cli.launch.console import Output
from obk_cli.launch.event_lines import LaunchReport
from obk_cli.launch.events import (
    Ended,
    InputEvent,
    OutputEvent,
    Phase,
    ProcessEnded,
    StackStateChanged,
)
from obk_cli.launch.run import _events, _process_events, _serve_others

from .shown import Shown


class Ros:
    """The interface to ROS, unused here."""

    def participant(self) -> None:
        return None


def test_a_socket_that_cannot_be_is_reported_and_no_more(tmp_path: Path) -> None:
    (tmp_path / "control.sock").write_text("in the way")
    screen = Shown()
    inbox: SimpleQueue[InputEvent] = SimpleQueue()
    output = Output(None, screen, LaunchReport((), colour=False, quiet=False), ())
    with ExitStack() as stack:
        _serve_others(tmp_path, Ros(), inbox, output, stack)  # type: ignore[arg-type]
    (line,) = screen.lines
    assert line.startswith("warning: other terminals cannot reach this launch: ")


def test_other_messages_of_the_launcher_are_in_the_runs_log_too(tmp_path: Path) -> None:
    output = Output(tmp_path, Shown(), LaunchReport((), colour=True, quiet=False), ())
    with output:
        output.note("warning: nothing is recorded, because the run has no folder")
    assert (tmp_path / "launch.log").read_text() == (
        "warning: nothing is recorded, because the run has no folder\n"
    )


def test_the_end_is_shown_after_the_recorder_and_the_videos_are_done() -> None:
    calls: list[str] = []

    def noting(name: str) -> Callable[[OutputEvent], None]:
        return lambda _: calls.append(name)

    recorder = SimpleNamespace(on_event=noting("recorder"))
    videos = SimpleNamespace(on_event=noting("videos"))
    quiet = SimpleNamespace(on_event=lambda _: None)
    output = SimpleNamespace(event=noting("shown"))
    bus = _events(recorder, videos, quiet, print, None, output)  # type: ignore[arg-type]
    bus.publish(Ended(exit_code=0, cause=""))
    assert calls == ["recorder", "videos", "shown"]


def test_the_state_node_shows_each_state_before_the_screen() -> None:
    calls: list[str] = []
    quiet = SimpleNamespace(on_event=lambda _: None)
    node = SimpleNamespace(show=calls.append)
    output = SimpleNamespace(event=lambda event: calls.append(type(event).__name__))
    bus = _events(quiet, quiet, quiet, print, node, output)  # type: ignore[arg-type]
    bus.publish(StackStateChanged(state="inactive"))
    bus.publish(Phase(name="ready", seconds=0.0))
    assert calls == ["inactive", "StackStateChanged", "Phase"]


def test_the_ends_of_processes_reach_the_recorder_and_the_inbox() -> None:
    seen: list[object] = []
    inbox: SimpleQueue[InputEvent] = SimpleQueue()
    recorder = SimpleNamespace(on_process_event=seen.append)
    end = ProcessEnded(process="/a", code=0)
    _process_events(recorder, inbox).publish(end)  # type: ignore[arg-type]
    assert seen == [inbox.get_nowait()] == [end]
