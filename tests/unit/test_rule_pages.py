"""The pages of the rules and the examples of `obk explain` are those of the table and the cases."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from obk_cli.cli.explain import command
from obk_cli.codes import RULES


@pytest.fixture(scope="module")
def rule_pages(repository: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "rule_pages", repository / "tools" / "rule_pages.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_nothing_that_is_generated_is_stale(
    rule_pages: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rule_pages.main(["--check"]) == 0, f"run `make docs`\n{capsys.readouterr().out}"


@pytest.mark.parametrize("code", RULES)
def test_explain_shows_a_wrong_and_a_right_example(
    code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command(code.lower())
    told = capsys.readouterr().out
    assert RULES[code].title in told
    assert "Wrong:\n    " in told
    assert "Right:\n    " in told
    assert f"[{code}]: " in told
