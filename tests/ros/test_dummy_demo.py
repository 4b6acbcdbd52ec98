"""`make demo`, the first command of the README, prints the output in the README."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from .stack import DEADLINE_S, EXAMPLE, calm, marked

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

README = EXAMPLE.parents[2] / "README.md"
SHOWN = re.compile(r"^(What happened\n.*?)^```$", re.DOTALL | re.MULTILINE)
LAST = "joint1 followed the command"
"""Printed only for a run of some seconds."""


@pytest.fixture
def demo(tmp_path: Path) -> Path:
    """The demo at 10 Hz, with limits that a busy machine can keep."""
    folder = tmp_path / "dummy"
    shutil.copytree(EXAMPLE.parent, folder)
    calm(folder)
    program = folder / "demo.py"
    text = program.read_text()
    assert text.count('"--duration"') == 1
    limits = f'"--timeout", "{DEADLINE_S:g}", "--hang-after", "20", "--duration"'
    program.write_text(text.replace('"--duration"', limits))
    return program


def shape(line: str) -> str:
    """A pattern for a line in which numbers and drawings may differ."""
    words = (re.escape(word) for word in re.split(r"[▁-█]+|[ ]*[\d.]+(?= |$)", line))
    return r"[▁-█ \d.]+".join(words)


def test_the_demo_prints_the_output_in_the_readme(demo: Path) -> None:
    done = subprocess.run(
        [sys.executable, demo, "6"],
        capture_output=True,
        text=True,
        timeout=4 * DEADLINE_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (shown,) = SHOWN.findall(README.read_text())
    *usual, last = shown.splitlines()
    assert LAST in last
    for line in usual:
        assert re.search(f"^{shape(line)}$", done.stdout, re.MULTILINE), (line, done.stdout)
    assert "joint1 " in done.stdout.splitlines()[-1]
    assert "Warning" not in done.stderr
    assert not marked()
