"""What the examples compile to, byte for byte. `make golden` rewrites the expected files."""

from pathlib import Path

import pytest

from obk_cli.emit.params import emit_params
from obk_cli.emit.plan_json import emit_plan
from obk_cli.pipeline import Options, compile_config
from obk_cli.plan import Plan

HERE = Path(__file__).parent
EXAMPLES = ("dummy/dummy.yaml", "dummy/dummy_new.yaml")


def compile_example(name: str, repository: Path) -> Plan:
    options = Options(environment={}, working_folder=repository, ignore=("OBK4", "OBK300"))
    outcome = compile_config(f"examples/{name}", options)
    assert outcome.plan is not None, outcome.diagnostics
    return outcome.plan


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.parametrize("form", ["params.yaml", "plan.json"])
def test_an_example_compiles_to_what_is_written_down(
    name: str,
    form: str,
    repository: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    monkeypatch.chdir(repository)
    plan = compile_example(name, repository)
    text = emit_plan(plan) if form == "plan.json" else emit_params(plan.processes)
    text = text.replace(str(repository), "<repository>")
    expected = HERE / f"{Path(name).stem}.{form}"
    if request.config.getoption("--update-golden"):
        expected.write_text(text, encoding="utf-8")
    assert text == expected.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_same_config_gives_the_same_bytes(
    name: str, repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(repository)
    first, second = (compile_example(name, repository) for _ in range(2))
    assert emit_plan(first) == emit_plan(second)
    assert emit_params(first.processes) == emit_params(second.processes)
