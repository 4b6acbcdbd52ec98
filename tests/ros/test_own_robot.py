"""The way to a robot of one's own, as `docs/how-to/own-robot.md` has it, at a real terminal."""

import os
import random
import re
import shutil
import socket
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from .user_shell import user_shell
from .walkthrough import Commands, apply, missing_lines, steps

pytestmark = pytest.mark.ros

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = ROOT / "docs" / "how-to" / "own-robot.md"
HARDWARE = ROOT / "examples" / "hardware"
ACTIVE = re.compile(r"s\] active$", re.MULTILINE)
LISTING = re.compile(r"```python\n(.*?)```", re.DOTALL)
USUAL_PORT = "47001"
NOT_HANDED_OUT = range(61_000, 65_536)
"""Ports that Linux gives to nobody who does not ask for them."""


def test_the_listings_are_the_examples() -> None:
    modules = [path.read_text() for path in HARDWARE.rglob("*.py")]
    listings = LISTING.findall(DOCUMENT.read_text())
    assert len(listings) == 3
    for listing in listings:
        assert any(listing in module for module in modules), listing


@pytest.mark.timeout(600)
def test_the_document_leads_to_a_stack_that_moves_the_motor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unused_udp_port: str
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    for path in (DOCUMENT, *(tmp_path / "examples" / "hardware").rglob("*.py")):
        copy = tmp_path / "own-robot.md" if path == DOCUMENT else path
        copy.write_text(path.read_text().replace(USUAL_PORT, unused_udp_port))
    path_variable = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    with user_shell(tmp_path, {**os.environ, "PATH": path_variable}) as shell:
        for step in steps(tmp_path / "own-robot.md"):
            if not isinstance(step, Commands):
                apply(step, tmp_path / "my_motor")
                continue
            seen = ""
            for line in step.lines:
                shell.enter(line)
                if line == "obk launch dummy_new.yaml":
                    shell.wait_for(ACTIVE)
                    shell.press_ctrl_c()
                assert shell.wait_for_prompt() == 0, (line, shell.seen)
                seen += shell.seen
            assert not missing_lines(step.shown, seen), seen


@pytest.fixture
def unused_udp_port() -> str:
    """The usual port may be another test run's, and what the kernel hands out may come again."""
    for port in random.sample(NOT_HANDED_OUT, 100):
        with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            line.bind(("127.0.0.1", port))
            return str(port)
    raise AssertionError(f"no port of {NOT_HANDED_OUT} is free")
