"""The page in a browser: plots with several fields, pause, the whole run; links to viewers."""

import base64
import math
import re
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
import pytest

from obelisk_spec.page_access import new_token
from obk_cli.errors import CommandFailedError
from obk_cli.monitor.model import StackView
from obk_cli.web.feed import Snapshot
from obk_cli.web.plots import FieldData, FieldRequest

from ....browser import opened, seen  # noqa: TID252 - shared by folders of tests
from ..monitor.stacks import HEALTHY  # noqa: TID252 - shared by folders of tests

pytest.importorskip("starlette", reason="starlette is in the `web` extra")
pytest.importorskip("uvicorn", reason="uvicorn is in the `web` extra")

from obk_cli.web.app import PageApi, WebServer, make_app, take_port

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser
STEP_NS = 20_000_000
UP_S = 300.0
EST, CTRL = "/obelisk/dummy/est q_joints", "/obelisk/dummy/ctrl u_mujoco[0]"


class Stack:
    """A stack that has been active for minutes, and whose fields are waves."""

    def __init__(self, *, is_recorded: bool) -> None:
        self.is_recorded = is_recorded
        self.started_s = time.time() - UP_S

    def snapshot(self) -> Snapshot:
        view = replace(HEALTHY, uptime_s=time.time() - self.started_s)
        return Snapshot(number=1, view=view, is_waiting=False)

    def subscribed(self, _: list[FieldRequest]) -> nullcontext[None]:
        return nullcontext()

    def data_after(self, request: FieldRequest, after_ns: int) -> FieldData:
        now_ns = time.time_ns()
        first = max(after_ns + 1, now_ns - 30_000_000_000)
        labels = ("q_joints[0]", "q_joints[1]") if request.field == "q_joints" else (request.field,)
        times = range(-(-first // STEP_NS) * STEP_NS, now_ns, STEP_NS)
        samples = tuple((ns, tuple(wave(ns * 1e-9, n) for n in range(len(labels)))) for ns in times)
        return FieldData(labels=labels, samples=samples, fault="")

    def history(self, _: StackView, requests: Sequence[FieldRequest]) -> list[dict[str, Any]]:
        if not self.is_recorded:
            raise CommandFailedError("the run is not recorded", help="record it")
        times = self.started_s + np.arange(0.0, UP_S, 0.1)
        values = np.array([wave(t, 0) for t in times])
        packed = {"times": packed_text(times), "values": packed_text(values)}
        lines = [{"label": "q_joints[0]", **packed}]
        return [
            {"curve": f"{one.topic} {one.field}", "fault": "", "lines": lines} for one in requests
        ]

    def of(self, _: StackView) -> dict[str, Any]:
        return {}


def wave(at_s: float, number: int) -> float:
    return math.sin(at_s + number)


def packed_text(numbers: Any) -> str:
    return base64.b64encode(numbers.astype("<f8").tobytes()).decode()


@contextmanager
def page_of(stack: Any, *plots: str) -> Iterator["Page"]:
    token, server = new_token(), WebServer()
    sources = (stack.snapshot, stack, stack.history, stack.of, stack, stack.of)
    site = PageApi(*sources, lambda: server.is_ending)
    with take_port(0) as listener:
        port = listener.getsockname()[1]
        app = make_app(site, token=token, port=port)
        thread = threading.Thread(target=server.run, args=[app, listener])
        thread.start()
        try:
            fields = "&".join(f"plot={quote(plot)}" for plot in plots)
            url = f"http://127.0.0.1:{port}/?token={token}#{fields}"
            with opened(url, width=1280, height=900) as page:
                yield page
        finally:
            server.end()
            thread.join()


def legend(page: "Page", place: int = 0) -> str:
    return page.locator(".legend").nth(place).inner_text()


def shown_span(page: "Page") -> tuple[float, float]:
    """The times of the first plot, which is paused [s]."""
    label = page.locator(".chart").first.get_attribute("aria-label") or ""
    begin, end = re.findall(r"-?[\d.]+", label)
    return float(begin), float(end)


class Simulated(Stack):
    """A stack whose first node is shown on a page."""

    def __init__(self) -> None:
        super().__init__(is_recorded=False)
        self.page = "http://127.0.0.1:8080/?token=abc"

    def snapshot(self) -> Snapshot:
        snapshot = super().snapshot()
        assert snapshot.view is not None
        first, *others = snapshot.view.nodes
        nodes = (replace(first, page=self.page), *others)
        return replace(snapshot, number=len(self.page), view=replace(snapshot.view, nodes=nodes))


def test_a_node_links_to_the_page_of_its_simulation_while_there_is_one() -> None:
    stack = Simulated()
    with page_of(stack) as page:
        links = page.locator("#nodes a.view:visible")
        seen(lambda: links.count() == 1, "one link")
        assert links.get_attribute("href") == stack.page
        stack.page = ""
        seen(lambda: links.count() == 0, "no link")


def test_fields_share_a_plot_or_have_their_own() -> None:
    with page_of(Stack(is_recorded=False), EST) as page:
        seen(lambda: re.search(r"q_joints\[1\]\s*\S*\d", legend(page)), "values")
        page.locator("#plot-topic").select_option("/obelisk/dummy/ctrl")
        page.locator("#plot-target").select_option("0")
        page.locator("#plot-field").fill("u_mujoco[0]")
        page.get_by_role("button", name="Plot", exact=True).click()
        seen(lambda: "ctrl.u_mujoco[0]" in legend(page), "both topics in one legend")
        assert "est.q_joints[1]" in legend(page)
        assert page.locator(".plot canvas").count() == 1

        page.locator("#plot-target").select_option("new")
        page.locator("#plot-field").fill("u_mujoco[0]")
        page.get_by_role("button", name="Plot", exact=True).click()
        seen(lambda: page.locator(".plot canvas").count() == 2, "another plot")
        # A cursor in one plot shows the values of all plots at its time.
        page.locator(".plot .u-over").first.hover(position={"x": 200, "y": 60})
        seen(lambda: re.search(r"\bt\s*[\d.]+ s", legend(page, 1)), "the time of the cursor")

        page.get_by_role("button", name=f"remove {CTRL}").first.click()
        seen(lambda: "u_mujoco" not in legend(page), "one field less")
        assert page.locator(".plot canvas").count() == 2
        address = page.url
        page.get_by_role("button", name=f"remove {EST}").click()
        seen(lambda: page.locator(".plot canvas").count() == 1, "one plot less")
        page.goto(address)
        seen(lambda: page.locator(".plot canvas").count() == 2, "the plots of the address")


def test_a_paused_plot_stops_and_is_zoomed_and_moved() -> None:
    with page_of(Stack(is_recorded=False), EST, CTRL) as page:
        seen(lambda: re.search(r"q_joints\[1\]\s*\S*\d", legend(page)), "values")
        page.get_by_role("button", name="Pause").click()
        begin, end = shown_span(page)
        assert end - begin == pytest.approx(30.0, abs=0.1)
        values = legend(page)
        box = page.locator(".plot .u-over").first.bounding_box()
        assert box is not None
        middle = box["y"] + box["height"] / 2

        def drag(first: float, last: float) -> None:
            page.mouse.move(box["x"] + first * box["width"], middle)
            page.mouse.down()
            page.mouse.move(box["x"] + last * box["width"], middle, steps=4)
            page.mouse.up()

        drag(0.25, 0.75)
        seen(lambda: shown_span(page)[1] - shown_span(page)[0] < 16.0, "a zoom")
        zoomed = shown_span(page)
        assert zoomed[1] - zoomed[0] == pytest.approx(15.0, abs=1.0)
        page.keyboard.down("Shift")
        drag(0.5, 0.75)
        page.keyboard.up("Shift")
        seen(lambda: shown_span(page)[0] < zoomed[0] - 2.0, "earlier times")
        other = page.locator(".chart").nth(1).get_attribute("aria-label")
        assert other == page.locator(".chart").first.get_attribute("aria-label")

        page.mouse.move(0, 0)
        assert legend(page) == values
        page.get_by_role("button", name="Resume").click()
        seen(lambda: legend(page) != values, "newer values")


def test_the_whole_run_comes_from_its_recording() -> None:
    with page_of(Stack(is_recorded=True), EST) as page:
        seen(lambda: re.search(r"q_joints\[1\]\s*\S*\d", legend(page)), "values")
        page.get_by_role("button", name="Whole run").click()
        seen(lambda: page.get_by_role("button", name="Resume").count() == 1, "the recording")
        begin, end = shown_span(page)
        assert begin == pytest.approx(0.0, abs=0.5)
        assert end > UP_S - 1.0


def test_that_a_run_was_not_recorded_is_reported() -> None:
    with page_of(Stack(is_recorded=False), EST) as page:
        page.get_by_role("button", name="Whole run").click()
        note = page.locator("#plot-note")
        seen(lambda: note.inner_text() == "the run is not recorded: record it", "why")
        assert page.get_by_role("button", name="Pause").count() == 1
