"""The page of a running stack, in a browser."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote, urlsplit
from urllib.request import Request, urlopen

import pytest

from ..browser import chromium, opened, seen  # noqa: TID252 - shared by folders of tests
from .stack import DUMMY, EXAMPLE, OBK, calm, eventually, launched, obk

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = [pytest.mark.ros, pytest.mark.mujoco, pytest.mark.browser, pytest.mark.timeout(900)]

pytest.importorskip("starlette", reason="starlette is in the `web` extra")

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "looking-into-a-stack.md"
HOSTILE = "<img src=x onerror=\"document.title='hurt'\"><script>document.title='hurt'</script>"
DRAWN = """canvas => {
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let colourful = 0;
  for (let at = 0; at < pixels.length; at += 4) {
    colourful += pixels[at + 3] > 128 && pixels[at + 2] - pixels[at] > 60;
  }
  return colourful;
}"""
"""The number of pixels of a canvas that are similar to the color of the first line, a blue."""


@contextmanager
def served(*options: str, command: Sequence[str] = ("obk", "web")) -> Iterator[str]:
    """The URL that `obk web` prints while it serves; stopped by Ctrl-C, with exit code 0."""
    process = subprocess.Popen(
        [OBK, *command[1:], "--port", "0", *options], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        assert " http://127.0.0.1:" in line
        yield line.split()[-1]
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
        process.stdout.close()


def text(page: "Page", selector: str) -> str:
    return page.locator(selector).first.inner_text()


def state(page: "Page", node: str) -> str:
    return text(page, f'#nodes tr[data-key="/obelisk_{node}"] .state')


def shown_in_document() -> list[str]:
    """The command as in the document."""
    lines = DOCUMENT.read_text().splitlines()
    (line,) = (line for line in lines if line.startswith("$ obk web"))
    return shlex.split(line.removeprefix("$ "), comments=True)


def test_a_stack_is_shown_changed_and_its_end_reported() -> None:
    chromium()
    with launched(DUMMY, "--record") as run, served(command=shown_in_document()) as url:
        asked: list[str] = []
        with opened("about:blank", width=1280, height=800) as page:
            page.on("request", lambda request: asked.append(request.url))
            plot = f"plot={quote('/obelisk/dummy/est q_joints')}"
            page.goto(f"{url}#{plot}")
            seen(lambda: state(page, "control_0") == "active", "that the controller is active")
            assert "token" not in page.url

            row = '#topics tr[data-key="/obelisk/dummy/est"]'
            seen(lambda: re.search("[1-9]", text(page, f"{row} .rate")), "a rate")
            first = text(page, row)
            seen(lambda: text(page, row) != first, "other figures")
            live = '#graph g[data-topic="/obelisk/dummy/est"] .live'
            rate = r"\d of [\d.]+ Hz"
            seen(lambda: re.search(rate, page.locator(live).text_content()), "a rate in the graph")
            seen(lambda: page.locator("canvas").evaluate(DRAWN) > 50, "a line")
            assert "q_joints[0]" in text(page, ".legend")
            page.get_by_role("button", name="Whole run").click()
            seen(lambda: page.get_by_role("button", name="Resume").count(), "the recording")
            # The recording may start shortly before the time from which the page counts.
            seen(lambda: max(0.0, shown_times(page)[0]) < shown_times(page)[1], "the times")
            assert not page.locator(".plot .fault").is_visible()
            page.get_by_role("button", name="Resume").click()

            node = page.locator('#nodes tr[data-key="/obelisk_control_0"]')
            node.get_by_role("button", name="deactivate").click()
            seen(lambda: state(page, "control_0") == "inactive", "that it is inactive")
            seen(lambda: "control_0 inactive" in text(page, "#notice"), "how it ended")
            assert '"inactive"' in obk("lifecycle", "get", "control_0", "--format", "json").stdout

            hostile_lines_are_text(page)
            a_change_that_may_move_the_robot_needs_confirmation(page)

            run.process.send_signal(signal.SIGINT)
            seen(lambda: "has ended" in text(page, "#notice"), "the end")
            assert page.locator("#nodes button, #stack-buttons button").count() == 0
            assert page.title() != "hurt"
    hosts = {urlsplit(one).hostname for one in asked if not one.startswith("about:")}
    assert hosts == {"127.0.0.1"}


def shown_times(page: "Page") -> tuple[float, float]:
    """The first and the last time in the plot, once it shows a recording [s]."""
    label = page.locator(".chart").get_attribute("aria-label") or ""
    times = [float(number) for number in re.findall(r"-?[\d.]+", label)]
    return (times[0], times[1]) if len(times) == 2 else (0.0, 0.0)


def hostile_lines_are_text(page: "Page") -> None:
    (folder,) = (Path(os.environ["OBK_HOME"]) / "runs").glob("dummy_*")
    with (folder / "launch.log").open("a") as log:
        log.write(f"robot_0 | {HOSTILE}\n")
    seen(lambda: HOSTILE in text(page, "#log"), "the line as text")
    assert page.locator("#log img, #log script").count() == 0


def a_change_that_may_move_the_robot_needs_confirmation(page: "Page") -> None:
    row = page.locator('#nodes tr[data-key="/obelisk_control_0"]')
    activate = row.get_by_role("button", name="activate", exact=False).first
    activate.click()
    seen(lambda: page.locator("#confirm").is_visible(), "the question")
    page.get_by_role("button", name="Cancel").click()
    assert state(page, "control_0") == "inactive"
    activate.click()
    page.locator("#confirm-yes").click()
    seen(lambda: state(page, "control_0") == "active", "that it is active again")


@pytest.mark.slow
def test_a_page_waits_for_a_stack_and_shows_the_next_one() -> None:
    chromium()
    with served() as url, opened(url, width=420, height=800) as page:
        seen(lambda: "No stack is running" in text(page, "#notice"), "that nothing runs")
        for _ in range(2):
            with launched(DUMMY):
                seen(lambda: text(page, "#state") == "active", "the stack")
                width = page.evaluate("document.documentElement.scrollWidth")
                assert width <= 420
            seen(lambda: text(page, "#state") == "ended", "its end")


@pytest.mark.slow
def test_fields_are_offered_and_faults_in_them_reported() -> None:
    chromium()
    with launched(DUMMY), served() as url, opened(url) as page:
        seen(lambda: state(page, "robot_0") == "active", "the stack")
        page.locator('#topics tr[data-key="/obelisk/dummy/imu"] button').click()
        offered = '#plot-fields option[value="angular_velocity.x"]'
        seen(lambda: page.locator(offered).count() == 1, "the field")
        for field in ("angular_velocity.w", "angular_velocity", "header.frame_id"):
            page.locator("#plot-field").fill(field)
            page.get_by_role("button", name="Plot", exact=True).click()
        seen(lambda: "has no field `w`" in text(page, ".plot .fault"), "what is wrong")
        canvas = page.locator(".plot canvas").nth(1)
        seen(lambda: canvas.evaluate(DRAWN) > 50, "the line of the other one")
        assert "angular_velocity.x" in page.locator(".plot .legend").nth(1).inner_text()
        text_reported = page.locator(".plot .fault").nth(2)
        seen(
            lambda: text_reported.inner_text() == "`header.frame_id` contains text, not numbers",
            "a text",
        )
        page.get_by_role("button", name="remove /obelisk/dummy/imu angular_velocity.w").click()
        assert page.locator(".plot").count() == 2


def test_a_port_that_is_taken_is_reported() -> None:
    with served() as url:
        port = urlsplit(url).port
        with urlopen(Request(url, headers={"Host": "localhost"}), timeout=20) as answer:
            assert answer.status == 200
        refused = obk("web", "--port", port)
        assert refused.returncode == 1
        assert f"port {port} on 127.0.0.1" in refused.stderr


BROWSER = """\
#!{python} -I
import sys
from pathlib import Path

Path({seen!r}).write_text(sys.argv[1])
"""
"""A program that is started as a browser and writes its URL argument to a file."""


@pytest.mark.slow
def test_a_browser_is_opened_without_the_token_on_its_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chromium()
    command_line, program = tmp_path / "command_line", tmp_path / "browser"
    program.write_text(BROWSER.format(python=sys.executable, seen=str(command_line)))
    program.chmod(0o755)
    monkeypatch.setenv("BROWSER", str(program))
    with served("--open") as url:
        eventually(
            lambda: command_line.exists() and command_line.read_text(), "that a browser is started"
        )
        address = command_line.read_text()
        file = Path(urlsplit(address).path)
        token = urlsplit(url).query.removeprefix("token=")
        assert token not in address
        assert file.parent.stat().st_mode & 0o077 == 0
        with opened(address) as page:
            seen(lambda: "No stack is running" in text(page, "#notice"), "the page")
            assert urlsplit(page.url).netloc == urlsplit(url).netloc
    assert not file.exists()


def test_parameters_are_tuned_by_sliders_and_fields_reset_and_saved(tmp_path: Path) -> None:
    chromium()
    arm = tmp_path / "arm" / "arm.yaml"
    shutil.copytree(EXAMPLE.parents[1] / "arm", arm.parent)
    calm(arm.parent)
    # Without its camera, because images take half of the CPU time.
    arm.write_text(arm.read_text().partition("      # Image of the camera")[0])
    with launched(arm), served() as url, opened(url, width=1280, height=900) as page:
        smoothing = page.get_by_label("estimation_0 time_constant_s", exact=True)
        seen(lambda: smoothing.count() == 1, "the parameters")
        slider = page.get_by_label("estimation_0 time_constant_s slider")
        slider.fill("0.05")
        row = page.locator(".parameter", has=slider)
        output = "time_constant_s changed from 0.005 to 0.05 s, in effect"
        seen(lambda: output in row.inner_text(), "the change")
        assert smoothing.input_value() == "0.05"
        of_node = ("param", "get", "estimation_0", "time_constant_s")
        assert obk(*of_node).stdout.split()[-1] == "0.05"

        smoothing.fill("7")
        smoothing.press("Enter")
        seen(lambda: "expected 0.001 to 0.1" in row.inner_text(), "the node's reason")
        page.get_by_label("reset estimation_0 time_constant_s").click()
        seen(lambda: "to 0.005 s, in effect" in row.inner_text(), "the reset")
        assert obk(*of_node).stdout.split()[-1] == "0.005"

        # A list has one field; changes from another terminal are shown too.
        gains = page.get_by_label("control_0 kd", exact=True)
        assert page.get_by_label("control_0 kd slider").count() == 0
        obk("param", "set", "control", "kd", "[6, 6, 6, 6, 6, 6]")
        seen(lambda: gains.input_value().startswith("[6.0, "), "the value of another terminal")

        # The edit is shown before it is written.
        before = arm.read_text()
        save = page.get_by_role("button", name="Save to config")
        save.click()
        diff = page.locator("#confirm-diff")
        seen(lambda: "+" in diff.inner_text() and "kd" in diff.inner_text(), "the edit")
        page.get_by_role("button", name="Cancel").click()
        assert arm.read_text() == before
        save.click()
        seen(diff.is_visible, "the edit again")
        page.locator("#confirm-yes").click()
        seen(lambda: "/obelisk_control_0: kd" in text(page, "#notice"), "what was written")
        assert "kd: [6.0, 6.0" in arm.read_text()
        save.click()
        seen(lambda: "nothing to write" in text(page, "#notice"), "that all is written")
