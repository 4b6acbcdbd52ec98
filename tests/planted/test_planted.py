"""Planted faults: each is found at its line and column with its help, and nothing else is.

`stack.yaml` has a comment below each faulty line, with the expected finding and the correct line.
`# ^` marks the column, `# ^-2` two columns to the right of it. Faults that stop the analysis of a
file cannot be combined with others; each of those is a case in `tests/cases`.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from obk_cli.compiler import Options, Outcome, compile_config
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.report import report_text
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import PackageIndex

HERE = Path(__file__).parent
WORKSPACE = HERE.parent / "cases" / "workspace"
ENVIRONMENT = {"HOME": "/home/ada"}
MARK = re.compile(r"\s*#\s+\^(?P<shift>-\d+)? (?P<code>OBK\d+)(?:: (?P<help>.*))?$")
RIGHT = re.compile(r"\s*# right: (?P<line>.*)$")

Planted = tuple[str, int, int, str, str | None]
"""File, line, column, code, help."""


def planted(path: Path) -> Iterator[Planted]:
    line_number = 0
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        mark = MARK.match(line)
        if mark:
            column = line.index("^") + 1 + int(mark["shift"] or 0)
            yield path.name, line_number, column, mark["code"], mark["help"]
        elif not RIGHT.match(line):
            line_number = number


def clean(path: Path) -> str:
    """The text with each faulty line replaced by the correct one."""
    lines: list[str] = []
    faulty, stands = "", False
    for line in path.read_text(encoding="utf-8").splitlines():
        right = RIGHT.match(line)
        if right:
            if stands:
                lines.pop()
                stands = False
            if right["line"] != "(nothing)":
                indent = faulty[: len(faulty) - len(faulty.lstrip())]
                lines.append(indent + right["line"])
        elif not MARK.match(line):
            faulty, stands = line, True
            lines.append(line)
    return "\n".join(lines) + "\n"


def compiled(path: Path, monkeypatch: pytest.MonkeyPatch) -> Outcome:
    monkeypatch.chdir(path.parent)
    environment = MachineEnvironment(path.parent, path.parent, ENVIRONMENT)
    environment.packages = PackageIndex(workspaces=(WORKSPACE,), prefixes=())
    options = Options(variables=ENVIRONMENT, working_folder=path.parent, environment=environment)
    return compile_config(path.name, options)


def reported(finding: Diagnostic, expected_help: str | None) -> Planted:
    """The finding in the format of the plants; a help that ends in dots is abbreviated."""
    help = finding.help
    if help and expected_help and expected_help.endswith("..."):
        is_right = help.startswith(expected_help.removesuffix("..."))
        help = expected_help if is_right else help
    return finding.span.path, finding.span.line, finding.span.column, finding.code, help


@pytest.mark.mujoco
def test_every_planted_fault_is_found_at_its_location_with_its_help(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    expected = sorted([*planted(HERE / "stack.yaml"), *planted(HERE / "wrong_scan.part")], key=str)
    helps = {fault[:4]: fault[4] for fault in expected}
    findings = compiled(HERE / "stack.yaml", monkeypatch).diagnostics
    found = [(f.span.path, f.span.line, f.span.column, f.code) for f in findings]
    received = [reported(f, helps.get(place)) for f, place in zip(findings, found, strict=True)]
    assert sorted(received, key=str) == expected


def test_the_file_has_sixty_kinds_of_faults() -> None:
    codes = {fault[3] for fault in planted(HERE / "stack.yaml")}
    assert len(codes) >= 60


@pytest.mark.mujoco
def test_the_clean_twin_has_no_findings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "stack.yaml").write_text(clean(HERE / "stack.yaml"), encoding="utf-8")
    (tmp_path / "scan.part").write_bytes((HERE / "scan.part").read_bytes())
    outcome = compiled(tmp_path / "stack.yaml", monkeypatch)
    assert report_text(outcome.diagnostics, colour=False) == ""
    assert outcome.plan is not None
