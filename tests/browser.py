"""Run a headless Chromium for the tests of pages, without a GPU and without its own traffic."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

from .waiting import eventually

if TYPE_CHECKING:
    from playwright.sync_api import Page

__all__ = ["chromium", "opened", "seen"]

DEADLINE_S: Final = 240.0
"""Timeout for a page; WebGL without a GPU is slow on a loaded machine [s]."""
DEADLINE_MS: Final = DEADLINE_S * 1000
NAMES: Final = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
ARGUMENTS: Final = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
WEBGL: Final = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
NO_WEBGL: Final = ("--disable-gpu",)


def chromium() -> Path:
    """The browser on this machine; skips the test if none is installed."""
    pytest.importorskip("playwright", reason="playwright is in the `dev` extra: make setup")
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip("there is no Chromium on this machine: apt install chromium")
    return Path(found)


@contextmanager
def opened(
    url: str, *, width: int = 640, height: int = 480, needs_webgl: bool = False
) -> Iterator["Page"]:
    """Open a page at `url`, of this size [pixels], in its own browser."""
    browser_path = chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=browser_path,
            args=[*ARGUMENTS, *(WEBGL if needs_webgl else NO_WEBGL)],
            timeout=DEADLINE_MS,
        )
        try:
            page = browser.new_page(viewport={"width": width, "height": height})
            page.set_default_timeout(DEADLINE_MS)
            page.goto(url)
            yield page
        finally:
            browser.close()


def seen(condition: Callable[[], object], what: str) -> None:
    """Wait until a page shows something; fail the test on timeout."""
    eventually(condition, what, deadline_s=DEADLINE_S, pause_s=0.2)
