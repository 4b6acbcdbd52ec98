"""The output of `obk compile` for the examples. `make golden` rewrites the expected files."""

import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest
import yaml

from obk_cli.compiler import Options, compile_config
from obk_cli.emit.formats import FORMS as PRINTED_FORMS
from obk_cli.emit.formats import Form
from obk_cli.emit.graph import graph_of
from obk_cli.emit.terminal import emit_terminal
from obk_cli.plan.plan import Plan
from obk_cli.workspace.environment import MachineEnvironment

HERE = Path(__file__).parent
DRAWING = Form(lambda plan: emit_terminal(graph_of(plan)), ".txt")
FORMS = {**PRINTED_FORMS, "drawing": DRAWING}
EXAMPLES = ("dummy/dummy.yaml", "dummy/dummy_new.yaml")
ROBOTS = ("arm/arm.yaml", "quadruped/quadruped.yaml")

PRINT_ALL_FORMS = """
import sys
from pathlib import Path
from obk_cli.emit.formats import FORMS
from obk_cli.compiler import Options, compile_config
options = Options(variables={}, working_folder=Path.cwd(), ignore=("OBK4",))
for name in sys.argv[1:]:
    plan = compile_config(f"examples/{name}", options).plan
    for form in FORMS.values():
        sys.stdout.write(form.emit(plan))
"""


def golden(name: str, form: str) -> Path:
    """The expected file; launch files have the suffix `.txt`, so that tools ignore them."""
    ending = FORMS[form].ending.replace(".py", ".py.txt")
    return HERE / f"{Path(name).stem}{ending}"


def compile_example(name: str, repository: Path) -> Plan:
    options = Options(variables={}, working_folder=repository, ignore=("OBK4", "OBK300"))
    outcome = compile_config(f"examples/{name}", options)
    assert outcome.plan is not None, outcome.diagnostics
    return outcome.plan


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.parametrize("form", FORMS)
def test_an_example_compiles_to_the_expected_output(
    name: str,
    form: str,
    repository: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    monkeypatch.chdir(repository)
    plan = compile_example(name, repository)
    text = FORMS[form].emit(plan).replace(str(repository), "<repository>")
    expected = golden(name, form)
    if request.config.getoption("--update-golden"):
        expected.write_text(text, encoding="utf-8")
    assert text == expected.read_text(encoding="utf-8")


@pytest.mark.parametrize("form", FORMS)
def test_both_formats_compile_to_the_same_plan_except_for_locations(form: str) -> None:
    old, new = (golden(name, form).read_text(encoding="utf-8") for name in EXAMPLES)
    if form == "plan":
        plans = [json.loads(text) for text in (old, new)]
        for process in (process for plan in plans for process in plan["processes"]):
            for made in (process, *process["rates"]):
                assert made.pop("origin")["path"].startswith("examples/dummy/")
        assert plans[0] == plans[1]
    else:
        assert old == new


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_compiled_plan_keeps_to_its_schema(name: str, repository: Path) -> None:
    schema = json.loads((repository / "schema/plan.schema.json").read_text(encoding="utf-8"))
    jsonschema.validate(json.loads(golden(name, "plan").read_text(encoding="utf-8")), schema)


@pytest.mark.parametrize("name", EXAMPLES)
def test_another_yaml_reader_finds_the_plans_parameters(name: str) -> None:
    plan = json.loads(golden(name, "plan").read_text(encoding="utf-8"))
    read = yaml.safe_load(golden(name, "params").read_text(encoding="utf-8"))
    assert read == {
        f"/{process['node']}": {"ros__parameters": process["parameters"]}
        for process in plan["processes"]
    }
    assert {
        "sub_ctrl_setting",
        "obelisk_settings",
        "mujoco_setting",
        "ic_keyframe",
        "use_sim_time",
    } == set(read["/obelisk_robot_0"]["ros__parameters"])


@pytest.mark.mujoco
@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_has_no_finding(name: str, repository: Path) -> None:
    config = repository / "examples" / name
    environment = MachineEnvironment(config.parent, repository, {})
    options = Options(variables={}, working_folder=repository, environment=environment)
    outcome = compile_config(str(config), options)
    assert outcome.plan is not None
    assert outcome.diagnostics == ()


def test_the_same_config_gives_identical_output_in_every_process(repository: Path) -> None:
    outputs = {
        subprocess.run(
            [sys.executable, "-c", PRINT_ALL_FORMS, *EXAMPLES],
            cwd=repository,
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": "src"},
            capture_output=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(outputs) == 1
    assert b"</svg>" in outputs.pop()
