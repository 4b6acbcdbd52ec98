"""The project's own workflow, and the actions that it, its documents and its templates use."""

import re
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

WORKFLOW = ".github/workflows/ci.yaml"
WITH_ACTIONS = (
    WORKFLOW,
    "action.yml",
    "docs/how-to/ci.md",
    "templates/workspace/.github/workflows/check.yaml.jinja",
)
USED = re.compile(r"uses: ([\w/-]+)@(\S+)(?: +# (v\S+))?")


@pytest.fixture
def workflow(repository: Path) -> dict[str, Any]:
    return dict(yaml.safe_load((repository / WORKFLOW).read_text()))


def steps(workflow: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for job in workflow["jobs"].values():
        yield from job["steps"]


def test_it_may_only_read_the_repository(workflow: dict[str, Any]) -> None:
    assert workflow["permissions"] == {"contents": "read"}
    assert not any("permissions" in job for job in workflow["jobs"].values())
    checkouts = [step for step in steps(workflow) if "checkout" in step.get("uses", "")]
    assert len(checkouts) == len(workflow["jobs"])
    assert all(step["with"] == {"persist-credentials": False} for step in checkouts)


def test_its_actions_are_pinned_to_commits(repository: Path) -> None:
    used = USED.findall((repository / WORKFLOW).read_text())
    assert used
    assert [name for name, commit, _ in used if not re.fullmatch("[0-9a-f]{40}", commit)] == []
    assert [name for name, _, version in used if not version] == []


def test_an_action_has_one_major_version_wherever_it_is_taken(repository: Path) -> None:
    majors = defaultdict[str, set[str]](set)
    for file in WITH_ACTIONS:
        for name, ref, version in USED.findall((repository / file).read_text()):
            if name != "ACCOUNT/REPOSITORY":
                majors[name].add((version or ref).partition(".")[0])
    assert {name: found for name, found in majors.items() if len(found) > 1} == {}
    assert {"actions/checkout", "actions/setup-python"} < majors.keys()


def test_it_runs_the_commands_that_developers_run(
    workflow: dict[str, Any], repository: Path
) -> None:
    targets = re.findall(r"(?m)^([\w-]+):", (repository / "Makefile").read_text())
    called = [step["run"] for step in steps(workflow) if "run" in step]
    ours = [line for line in called if "apt-get" not in line]
    assert (repository / ".ci/run").stat().st_mode & 0o100
    assert all(line == ".ci/run" or line.split()[1] in targets for line in ours)
    assert set(ours) == {
        *(".ci/run", "make test-unit", "make test-slow", "make wheel", "make audit")
    }


def test_every_supported_python_is_tested(workflow: dict[str, Any], repository: Path) -> None:
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    promised = re.findall(r"Python :: (3\.\d+)", "\n".join(project["classifiers"]))
    newer = workflow["jobs"]["newer-python"]["strategy"]["matrix"]["python"]
    (first,) = (
        step["with"]["python-version"]
        for step in workflow["jobs"]["everything"]["steps"]
        if "setup-python" in step.get("uses", "")
    )
    assert [first, *newer] == promised
