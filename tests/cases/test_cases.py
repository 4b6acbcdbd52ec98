"""Each file in `reject/OBKnnn` or `accept/OBKnnn` is a test.

The report of a reject case is in the `.txt` next to it; an accept case has no findings.
`# set: path=value` on the first line is a `--set`. A `.part` is not a separate case. A folder
`.packages` contains packages of the case. Cases of OBK6 are checked for lockstep runs.
"""

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from obk_cli.compiler import Options, Outcome, compile_config
from obk_cli.diagnostics.rules import LOCKSTEP_FAMILY, RULES
from obk_cli.report import report_sarif, report_text
from obk_cli.workspace.config_files import configs_that_include
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import PackageIndex

HERE = Path(__file__).parent
WORKSPACE = HERE / "workspace"
SARIF = jsonschema.Draft202012Validator(json.loads((HERE / "sarif.schema.json").read_text()))
ENVIRONMENT = {"OBK_CASE_PKG": "demo", "HOME": "/home/ada"}
WITHOUT_CASE = {
    "OBK001": "tests/unit/obk_cli/test_compiler.py",
    "OBK007": "tests/unit/obk_cli/config/test_yaml_parser.py",
    "OBK300": "tests/unit/obk_cli/check/test_simulation.py",
}
"""Codes whose fault cannot be shown in a short text -> the tests that cover them."""


def cases(kind: str) -> list[object]:
    """The files of one kind; those of the model family are marked."""
    marks = {"OBK3": pytest.mark.mujoco, "OBK215": pytest.mark.mujoco}
    return [
        pytest.param(
            path,
            id=f"{path.parent.name}/{path.stem}",
            marks=[mark for code, mark in marks.items() if path.parent.name.startswith(code)],
        )
        for path in sorted((HERE / kind).glob("*/*.yaml"))
    ]


def compile_case(path: Path, monkeypatch: pytest.MonkeyPatch) -> Outcome:
    """Compile a case from its own folder, with the packages of the cases' workspace."""
    monkeypatch.chdir(path.parent)
    environment = MachineEnvironment(path.parent, path.parent, ENVIRONMENT)
    own = path.with_suffix(".packages")
    workspaces = (own, WORKSPACE) if own.is_dir() else (WORKSPACE,)
    environment.packages = PackageIndex(workspaces=workspaces, prefixes=())
    first = path.read_bytes().splitlines()[0].decode(errors="replace")
    overrides = (first.removeprefix("# set: "),) if first.startswith("# set: ") else ()
    options = Options(
        variables=ENVIRONMENT,
        working_folder=path.parent,
        overrides=overrides,
        environment=environment,
        including=configs_that_include,
        for_test=path.parent.name.startswith(LOCKSTEP_FAMILY),
    )
    return compile_config(path.name, options)


@pytest.mark.parametrize("path", cases("reject"))
def test_a_fault_is_reported_word_for_word(
    path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    outcome = compile_case(path, monkeypatch)
    report = report_text(outcome.diagnostics, colour=False, verbose=True) + "\n"
    for folder, shown in ((HERE, "<cases>"), (HERE.parents[1], "<repository>")):
        report = report.replace(str(folder), shown)
    expected = path.with_suffix(".txt")
    if request.config.getoption("--update-golden"):
        expected.write_text(report, encoding="utf-8")
    assert report == expected.read_text(encoding="utf-8")
    assert path.parent.name in {diagnostic.code for diagnostic in outcome.diagnostics}


@pytest.mark.parametrize("path", cases("accept"))
def test_the_right_twin_is_not_reported(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = compile_case(path, monkeypatch)
    assert report_text(outcome.diagnostics, colour=False) == ""
    assert outcome.plan is not None


def one_of_each_family() -> list[object]:
    """The first reject case of OBK0, OBK1, and so on."""
    first: dict[str, Path] = {}
    for path in sorted((HERE / "reject").glob("*/*.yaml")):
        first.setdefault(path.parent.name[:4], path)
    marks = {"OBK3": [pytest.mark.mujoco]}
    return [
        pytest.param(path, id=family, marks=marks.get(family, ())) for family, path in first.items()
    ]


@pytest.mark.parametrize("path", one_of_each_family())
def test_the_sarif_log_of_a_fault_follows_the_standard(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = json.loads(report_sarif(compile_case(path, monkeypatch).diagnostics))
    SARIF.validate(log)
    (run,) = log["runs"]
    rules = [rule["id"] for rule in run["tool"]["driver"]["rules"]]
    assert run["results"]
    for result in run["results"]:
        assert rules[result["ruleIndex"]] == result["ruleId"]
        for place in (*result["locations"], *result["relatedLocations"]):
            assert_is_a_stretch(place["physicalLocation"]["region"])


def assert_is_a_stretch(region: dict[str, Any]) -> None:
    start = (region["startLine"], region["startColumn"])
    assert start <= (region["endLine"], region["endColumn"])


def test_every_rule_has_a_reject_case_and_an_accept_twin() -> None:
    for kind in ("reject", "accept"):
        covered = {path.name for path in (HERE / kind).iterdir()} | WITHOUT_CASE.keys()
        assert covered == RULES.keys()
