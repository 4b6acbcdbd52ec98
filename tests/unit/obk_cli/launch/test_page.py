"""The URL of a simulation's page: from the robot's report to the terminal, `obk ps`, `obk web`."""

import json
from collections import deque
from pathlib import Path
from queue import SimpleQueue

import pytest

from obelisk_spec.control_socket import RUN_FOLDER_VARIABLE, report_page
from obk_cli.cli.ps import _text
from obk_cli.launch.control_server import serve_control
from obk_cli.launch.event_lines import LaunchReport
from obk_cli.launch.events import InputEvent, PageReported, ProcessEnded, StatusRequested
from obk_cli.launch.status import status_lines, with_event
from obk_cli.runs.folder import Run
from obk_cli.runs.protocol import Fault, PageRequest, StackStatus, decode_request
from obk_cli.runs.registry import LiveStack

from .test_status import PLAN, ROBOT, status_after
from .world import World

URL = "http://127.0.0.1:8080/?token=" + "aB3-_xyz" * 4
SHOWN = PageReported(node=ROBOT, url=URL)
GONE = PageReported(node=ROBOT, url="")


def test_a_robot_reports_its_page_to_its_launcher_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    received: SimpleQueue[InputEvent] = SimpleQueue()
    monkeypatch.setenv(RUN_FOLDER_VARIABLE, str(tmp_path))
    with serve_control(tmp_path, received.put):
        report_page(ROBOT, URL)
        report_page(ROBOT, "")
    assert [received.get(timeout=1), received.get(timeout=1)] == [SHOWN, GONE]
    assert capfd.readouterr() == ("", "")


def test_without_a_launcher_the_url_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv(RUN_FOLDER_VARIABLE, raising=False)
    report_page(ROBOT, URL)
    monkeypatch.setenv(RUN_FOLDER_VARIABLE, str(tmp_path / "removed"))
    report_page(ROBOT, URL)
    report_page(ROBOT, "")
    assert capfd.readouterr().out == f"the simulation is shown at {URL}\n" * 2


@pytest.mark.parametrize(
    "url",
    [
        "javascript:alert(1)",
        "http://evil.example/?token=a",
        "http://127.0.0.1:8080/?token=a\nb",
        "http://127.0.0.1:8080@evil.example/?token=a",
        URL + "\x1b[2J",
        "http://127.0.0.1:8080/",
    ],
)
def test_other_urls_are_rejected(url: str) -> None:
    line = json.dumps({"ask": "page", "node": ROBOT, "url": url}).encode()
    assert isinstance(decode_request(line), Fault)
    line = json.dumps({"ask": "page", "node": ROBOT, "url": URL}).encode()
    assert decode_request(line) == PageRequest(node=ROBOT, url=URL)


def test_a_page_is_an_event_and_part_of_the_status_until_its_process_ends() -> None:
    answers: list[StackStatus] = []
    ask = StatusRequested(reply=answers.append)
    unknown = PageReported(node="/unknown", url=URL)
    ended = ProcessEnded(process=ROBOT, code=-9)
    later = deque([1.0, SHOWN, SHOWN, unknown, ask, ended, 1.0, ask])
    world = World(later=later, on_crash="ignore")
    world.run(duration_s=20)
    pages = [{node.node: node.page for node in answer.nodes}[ROBOT] for answer in answers]
    assert pages == [URL, ""]
    assert [event for event in world.published if isinstance(event, PageReported)] == [SHOWN]


@pytest.mark.parametrize(("width", "height"), [(100, 40), (40, 24), (20, 8), (10, 4)])
def test_the_status_area_shows_the_whole_url_whatever_its_size(width: int, height: int) -> None:
    status = status_after(SHOWN)
    assert URL in "".join(status_lines(status, width, height, colour=True))
    assert URL not in "".join(status_lines(with_event(status, GONE), width, height, colour=True))


def test_the_report_says_where_the_simulation_is_shown_even_if_quiet() -> None:
    report = LaunchReport((ROBOT,), colour=False, quiet=True)
    assert list(report.event(SHOWN)) == [f"  robot_0: the simulation is shown at {URL}"]
    assert list(report.event(GONE)) == []


def test_obk_ps_shows_the_url(tmp_path: Path) -> None:
    nodes = tuple(node.full_name for node in PLAN.nodes)
    run = Run(name="dummy", pid=1, started=0.0, domain=0, config="dummy.yaml", nodes=nodes)
    stack = LiveStack(folder=tmp_path, run=run, status=status_after(SHOWN))
    (line,) = (line for line in _text(stack) if ROBOT in line)
    assert line.endswith(f"shown at {URL}")
