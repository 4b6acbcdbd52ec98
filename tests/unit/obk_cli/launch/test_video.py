"""Lines of a launch about the videos that its robots record."""

from dataclasses import replace
from typing import Literal

import pytest

from obelisk_spec.video import VideoStatus
from obk_cli.launch.events import Ended, OutputEvent, Phase, VideoReported
from obk_cli.launch.process_groups import share_of
from obk_cli.launch.recorder import VideoReports
from obk_cli.plan.plan import Plan

from ..plans import node  # noqa: TID252 - shared by folders of tests

ROBOT = node("robot_0", "robot", parameters={"render": "/here/out.mp4"}, model="arm.xml")
ACTIVE = Phase(name="active", seconds=1.0)
ENDED = Ended(exit_code=0, cause="")


def film(state: Literal["recording", "finished", "failed"], detail: str = "") -> VideoReported:
    status = VideoStatus(state=state, path="/here/out.mp4", detail=detail)
    return VideoReported(node="/robot_0", video=status)


BEGUN, MADE, LOST = film("recording"), film("finished", "10.0 s"), film("failed", "disk full")
MADE_TEXT, LOST_TEXT = str(MADE.video), str(LOST.video)


def shown(*events: OutputEvent, robot: object = ROBOT) -> list[str]:
    """The lines of a run with these events."""
    notes: list[str] = []
    plan = Plan(name="s", nodes=(robot,))  # type: ignore[arg-type]
    films = VideoReports(plan, share_of(plan, None), notes.append)
    for event in events:
        films.on_event(event)
    return notes


@pytest.mark.parametrize(
    ("events", "lines"),
    [
        ((BEGUN, ACTIVE, MADE), []),
        ((BEGUN, ACTIVE, MADE, ENDED), [MADE_TEXT]),
        ((BEGUN, ACTIVE, LOST, ENDED), [LOST_TEXT]),
        ((BEGUN, MADE, BEGUN, MADE, ENDED), [MADE_TEXT, MADE_TEXT]),
    ],
)
def test_the_result_of_each_film_is_shown_at_the_end(
    events: tuple[OutputEvent, ...], lines: list[str]
) -> None:
    assert shown(*events) == lines


def test_a_robot_that_begins_no_film_is_named_when_the_stack_is_active() -> None:
    (line,) = shown(ACTIVE, ENDED)
    assert line.startswith("warning: ")
    assert "`/robot_0`" in line


def test_a_film_without_a_result_is_a_warning() -> None:
    (line,) = shown(BEGUN, ACTIVE, ENDED)
    assert line.startswith("warning: ")


def test_no_film_is_missed_without_render() -> None:
    assert shown(ACTIVE, ENDED, robot=replace(ROBOT, parameters={})) == []
