"""What a launch tells of the film that its robot makes."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from obk_cli.launch.devices import share_of
from obk_cli.launch.events import Ended, Phase
from obk_cli.plan.plan import Plan
from obk_cli.running import film as film_module
from obk_cli.running.film import Film

from ..plans import node  # noqa: TID252 - shared by folders of tests

ROBOT = node("robot_0", "robot", parameters={"render": "/here/out.mp4"}, model="arm.xml")
LOGGED = "[INFO] [1795289372.075278335] [robot_0]: "


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(film_module, "_WAIT_S", 0.01)


def told(*happened, robot=ROBOT):
    """What is told in a run in which nodes write these lines and these things happen."""
    every, heard = [], []
    plan = Plan(name="s", processes=(robot,))
    film = Film(plan, share_of(plan, None), SimpleNamespace(note=every.append))
    line = film.lines(lambda unit, text: heard.append((unit, text)))
    tell = film.telling(lambda event: every.append(type(event).__name__))
    for one in happened:
        if isinstance(one, str):
            line("/robot_0", one)
        else:
            tell(one)
    assert len(heard) == sum(isinstance(one, str) for one in happened)
    return every


BEGUN = f"{LOGGED}a film goes to /here/out.mp4"
MADE = "film: /here/out.mp4, 300 frames, 10.0 s, 2 dropped"
ACTIVE = Phase(name="active", seconds=1.0)
ENDED = Ended(exit_code=0, cause="")


def test_the_film_is_told_before_the_end() -> None:
    assert told(BEGUN, ACTIVE, f"{LOGGED}{MADE}", ENDED) == ["Phase", MADE, "Ended"]


def test_a_film_that_broke_off_is_told_with_its_reason() -> None:
    lost = "/here/out.mp4: No space left on device; there is no film"
    assert told(BEGUN, ACTIVE, f"{LOGGED}{lost}", ENDED) == ["Phase", lost, "Ended"]


def test_each_film_of_a_robot_that_was_started_again_is_told() -> None:
    second = MADE.replace("out", "out-2")
    lines = (BEGUN, f"{LOGGED}{MADE}", BEGUN, f"{LOGGED}{second}")
    assert told(*lines, ENDED) == [MADE, second, "Ended"]


def test_a_robot_that_takes_no_notice_is_told_when_the_stack_is_active() -> None:
    assert told(ACTIVE, ENDED) == [
        "Phase",
        "warning: no film has begun, which `render` asks for of `/robot_0`",
        "Ended",
    ]


def test_a_robot_that_says_nothing_at_the_end_is_told() -> None:
    assert told(BEGUN, ACTIVE, ENDED) == [
        "Phase",
        "warning: what has become of the film was not told",
        "Ended",
    ]


def test_without_a_film_nothing_is_told_of_one() -> None:
    robot = replace(ROBOT, parameters={})
    assert told(BEGUN, ACTIVE, f"{LOGGED}{MADE}", ENDED, robot=robot) == ["Phase", "Ended"]
