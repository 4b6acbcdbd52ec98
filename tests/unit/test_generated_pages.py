"""All generated files are up to date: rules, reference, pictures, examples of `obk explain`."""

from pathlib import Path
from types import ModuleType

import design_drawings
import pictures
import pytest
import reference_pages
import rule_pages

from obk_cli.cli.explain import command
from obk_cli.diagnostics.rules import RULES


@pytest.mark.parametrize(
    "generator",
    [
        pytest.param(rule_pages, id="rules"),
        pytest.param(reference_pages, id="reference"),
        pytest.param(pictures, id="pictures", marks=pytest.mark.mujoco),
    ],
)
def test_no_generated_file_is_stale(
    generator: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert generator.main(["--check"]) == 0, f"run `make docs`\n{capsys.readouterr().out}"


@pytest.mark.parametrize("code", ["OBK001", "OBK205", "OBK504"])
def test_explain_shows_a_wrong_and_a_correct_example(
    code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command(code.lower())
    reported = capsys.readouterr().out
    assert RULES[code].title in reported
    assert "Wrong:\n    " in reported
    assert "Right:\n    " in reported
    assert f"[{code}]: " in reported


def test_the_diagram_shows_the_stages_of_the_source(repository: Path) -> None:
    source = repository / "src" / "obk_cli"
    named = {box.name for box in design_drawings.STAGES} - {"stack.yaml"}
    for name in named:
        assert any(source.rglob(f"{name}.py")) or (source / name).is_dir(), name
