"""From a model to a running stack, as `docs/how-to/own-model.md` has it, at a real terminal."""

import os
import re
import sys
from pathlib import Path

import pytest

from .user_shell import user_shell
from .walkthrough import Commands, apply, missing_lines, steps

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "own-model.md"
MODEL = re.compile(
    r"as `(?P<path>[^`]+\.xml)`:\n\n```xml\n(?P<text>.*?)^```$", re.DOTALL | re.MULTILINE
)
ACTIVE = re.compile(r"s\] active$", re.MULTILINE)


@pytest.mark.timeout(600)
def test_a_model_becomes_a_running_stack_as_the_document_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    model = MODEL.search(DOCUMENT.read_text())
    assert model is not None
    path = tmp_path / model["path"]
    path.parent.mkdir(parents=True)
    path.write_text(model["text"])
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    with user_shell(tmp_path, environment) as shell:
        for step in steps(DOCUMENT):
            if not isinstance(step, Commands):
                apply(step, tmp_path / "cart")
                continue
            seen = ""
            for line in step.lines:
                shell.enter(line)
                if line.startswith("obk launch"):
                    shell.wait_for(ACTIVE)
                    shell.press_ctrl_c()
                code = shell.wait_for_prompt()
                assert code == int(line == step.lines[-1] and step.finds_errors), (line, shell.seen)
                seen += shell.seen
            assert not missing_lines(step.shown, seen), seen
