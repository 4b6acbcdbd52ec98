"""A simulated robot of a running stack, viewed in a browser."""

import io
import os
from collections.abc import Iterator
from http import HTTPStatus
from typing import TYPE_CHECKING
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import urlopen

import numpy as np
import pytest
from numpy.typing import NDArray

from ..browser import chromium, opened, seen  # noqa: TID252 - shared by folders of tests
from ..waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests
from .stack import DUMMY, Launched, arguments_of, eventually, launched, obk

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = [pytest.mark.ros, pytest.mark.mujoco, pytest.mark.browser, pytest.mark.timeout(600)]

SHOWN = "the simulation is shown at "


def address(run: Launched) -> str:
    """The URL of the page that the launch prints."""
    run.wait_for_line(SHOWN)
    line = next(line for line in run.lines if SHOWN in line)
    return line.partition(SHOWN)[2].split()[0]


def opens(url: str) -> bool:
    """Whether a browser gets the page at a URL, as opposed to the status 403."""
    try:
        with urlopen(url, timeout=DEADLINE_S) as page:
            return b"<html" in page.read().lower()
    except HTTPError as error:
        error.close()
        if error.code != HTTPStatus.FORBIDDEN:
            raise
        return False


def picture(page: "Page") -> NDArray[np.int16]:
    """The content of the page's canvas, shape `(height, width, 3)`."""
    image = pytest.importorskip("PIL.Image")
    shot = page.locator("canvas").first.screenshot()
    return np.asarray(image.open(io.BytesIO(shot)).convert("RGB"), np.int16)


def reddish(pixels: NDArray[np.int16]) -> int:
    """The number of pixels that are similar to the color of the dummy's ball."""
    red, green, blue = np.moveaxis(pixels, -1, 0)
    return int(np.count_nonzero((red - green > 40) & (red - blue > 30)))


@pytest.mark.slow
def test_the_page_shows_the_model_and_that_it_moves() -> None:
    chromium()
    pytest.importorskip("mjviser")
    with launched(DUMMY, "--viewer", "web") as run:
        url = address(run)
        assert urlsplit(url).hostname == "127.0.0.1"
        asked: list[str] = []
        with opened("about:blank", width=480, height=360, needs_webgl=True) as page:
            page.on("request", lambda request: asked.append(request.url))
            page.goto(url)
            page.wait_for_selector("canvas")
            seen(lambda: reddish(picture(page)) > 30, "the ball")
            first = picture(page)
            seen(lambda: np.abs(picture(page) - first).max() > 60, "that the rod moves")
        hosts = {urlsplit(url.removeprefix("blob:")).hostname for url in asked}
        assert hosts == {"127.0.0.1"}
    assert run.left_over() == []


@pytest.fixture
def _batch_policy() -> Iterator[None]:
    """Start processes with a policy that, unlike real-time policies, every user may choose."""
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    yield
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@pytest.mark.usefixtures("_batch_policy")
def test_nodes_inherit_the_scheduling_policy_and_viewers_do_not() -> None:
    pytest.importorskip("mjviser")
    with launched(DUMMY, "--viewer", "web") as run:
        run.wait_for_line(SHOWN)
        run.wait_for("active")
        viewer = next(p for p in run.descendants if "web" in arguments_of(p))
        assert os.sched_getscheduler(viewer.pid) == os.SCHED_OTHER
        nodes = [run.node(f"obelisk_{name}_0") for name in ("control", "estimation", "robot")]
        assert [os.sched_getscheduler(p.pid) for p in nodes] == [os.SCHED_BATCH] * 3
    assert run.left_over() == []


def test_a_killed_viewer_is_reported_and_the_stack_continues() -> None:
    pytest.importorskip("mjviser")
    with launched(DUMMY, "--viewer", "web") as run:
        url = address(run)
        run.wait_for("active")
        assert opens(url)
        assert not opens(url.partition("?")[0])
        assert url in obk("ps").stdout
        token = url.partition("?token=")[2]
        assert not any(token in word for p in run.descendants for word in arguments_of(p))
        viewer = next(p for p in run.descendants if "web" in arguments_of(p))
        viewer.kill()
        run.wait_for_line(
            "the web viewer has exited (signal 9); the simulation continues without it"
        )
        eventually(lambda: url not in obk("ps").stdout, "that the page has gone")
        assert run.process.poll() is None
    assert run.left_over() == []


def test_without_a_display_the_stack_runs_and_reports_a_fix(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with launched(DUMMY, "--viewer", "native") as run:
        run.wait_for_line("the native viewer needs a display")
        assert run.process.poll() is None
