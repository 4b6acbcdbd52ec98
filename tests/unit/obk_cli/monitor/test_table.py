"""A running stack as text in a terminal: all lines, and what narrow terminals omit."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from rich.cells import cell_len

from obk_cli.monitor.model import StackView
from obk_cli.monitor.table import (
    head_line,
    log_lines,
    monitor_data,
    monitor_text,
    node_lines,
    topic_lines,
)
from obk_cli.terminal import plain

from .stacks import BROKEN, COMPOSED, ELSEWHERE, HEALTHY

SHOWN = Path(__file__).parent / "shown"


@pytest.mark.parametrize(
    ("view", "width", "name"),
    [
        (HEALTHY, 80, "healthy_80"),
        (BROKEN, 80, "broken_80"),
        (BROKEN, 160, "broken_160"),
        (COMPOSED, 160, "composed_160"),
        (ELSEWHERE, 80, "elsewhere_80"),
    ],
)
def test_a_stack_is_shown_whole(
    view: StackView, width: int, name: str, request: pytest.FixtureRequest
) -> None:
    text = monitor_text(view, width, colour=False) + "\n"
    file = SHOWN / f"{name}.txt"
    if request.config.getoption("--update-golden"):
        file.write_text(text, encoding="utf-8")
    assert text == file.read_text(encoding="utf-8")
    coloured = monitor_text(view, width, colour=True).splitlines()
    assert [plain(line) for line in coloured] == text.splitlines()


@pytest.mark.parametrize("width", [20, 40, 60, 79, 80, 100, 120, 160, 200])
def test_no_line_is_wider_than_the_terminal(width: int) -> None:
    long = replace(BROKEN.topics[0], topic="/über/" + "sehr/" * 40 + "lang")
    view = replace(BROKEN, topics=(*BROKEN.topics, long), lines=("x" * 300, "\U0001f916" * 150))
    text = monitor_text(view, width, colour=False)
    assert max(map(cell_len, text.splitlines())) <= width
    assert "880" in text or width < 40


def test_a_long_name_is_truncated_before_the_state_of_the_stack() -> None:
    head, *_ = monitor_text(replace(BROKEN, name="arm" * 40), 80, colour=False).splitlines()
    assert head.startswith(f"{'arm' * 8}a…  inactive  up 0:01:23  2 topics off")


def test_a_simulation_that_is_too_slow_is_one_red_line() -> None:
    steps = replace(BROKEN.nodes[0].rates[0], name="steps")
    robot = replace(HEALTHY.nodes[2], rates=(steps,))
    slow = replace(HEALTHY, nodes=(*HEALTHY.nodes[:2], robot), realtime_factor=0.46)
    assert "simulation too slow  real time x0.46" in head_line(slow, 80).text
    wrong = [
        line for line in (*node_lines(slow, 80), *topic_lines(slow, 80)) if "red" in line.style
    ]
    assert [line.text.split()[0] for line in wrong] == ["robot_0"]
    assert "simulation too slow" not in head_line(HEALTHY, 80).text


def test_a_topic_that_is_off_is_marked_in_text_and_for_programs() -> None:
    marked = [
        line for line in monitor_text(BROKEN, 80, colour=False).splitlines() if line[:1] == "!"
    ]
    assert [line.split()[1] for line in marked] == ["joint_encoders", "est"]
    data = json.loads(json.dumps(monitor_data(BROKEN)))
    assert [topic["is_off"] for topic in data["topics"]] == [True, True, False]
    assert data["nodes"][0]["rates"][0]["standing"] == "broken"
    assert data["nodes"][1]["load"]["memory_bytes"] == 74_000_000


def test_a_stack_that_has_ended_shows_the_cause() -> None:
    view = replace(HEALTHY, state="", has_ended=True, cause="/a hangs\x1b[2J", nodes=())
    (head, *_) = monitor_text(view, 80, colour=False).splitlines()
    assert head.startswith("dummy  has stopped: /a hangs  ")
    silent = replace(HEALTHY, state="", phase="")
    assert "launcher does not answer" in monitor_text(silent, 80, colour=False)


def test_the_log_is_filtered_case_insensitively() -> None:
    assert [line.text for line in log_lines(HEALTHY, 80, "FELL")] == [
        "robot_0      | [WARN] the simulation fell behind"
    ]
    assert len(log_lines(HEALTHY, 80)) == 3
