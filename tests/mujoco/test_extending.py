"""The examples in `docs/extending.md`, applied to a copy of the files that they change."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ..documents import (  # noqa: TID252 - shared by folders of tests
    Commands,
    apply,
    steps,
)

pytestmark = [pytest.mark.mujoco, pytest.mark.timeout(400)]

DOCUMENT = Path("docs/extending.md")
NEEDED = ("src", "schema", "templates", "examples/dummy", "tests/cases", "tests/golden")
ALONE = (
    "pyproject.toml",
    "tests/conftest.py",
)
ADDED = "OBK299 or MagneticField or magnetic or csv-dummy/dummy.yaml"


@pytest.fixture(scope="module")
def extended(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the required part of the repository, with everything that the page adds."""
    copy = tmp_path_factory.mktemp("repository")
    unwanted = shutil.ignore_patterns("__pycache__", ".obk", "build", "test_transcripts.py")
    for folder in NEEDED:
        shutil.copytree(repository / folder, copy / folder, ignore=unwanted)
    (copy / "tests/mujoco").mkdir()
    for file in ALONE:
        (copy / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(repository / file, copy / file)
    for file in ("conftest.py", "groups.py", "test_sensors.py"):
        shutil.copy(repository / "tests/mujoco" / file, copy / "tests/mujoco")
    for step in steps(repository / DOCUMENT):
        if not isinstance(step, Commands):
            apply(step, copy)
            continue
        for line in step.lines:
            subprocess.run(["sh", "-c", line], cwd=copy, check=True, timeout=20)
    return copy


@pytest.mark.slow
def test_the_added_code_is_tested_and_valid(extended: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-rA", "-k", ADDED],
        cwd=extended,
        env={**os.environ, "PYTHONPATH": str(extended / "src")},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    for reported in (
        "test_a_fault_is_reported_word_for_word[OBK299/hardware]",
        "test_the_right_twin_is_not_reported[OBK299/hardware]",
        "test_a_kind_publishes_the_type_of_the_language[MagneticField]",
        "test_the_field_is_given_in_the_frame_of_its_site",
        "test_an_example_compiles_to_the_expected_output[csv-dummy/dummy.yaml]",
    ):
        assert re.search(rf"^PASSED .*{re.escape(reported)}$", done.stdout, re.MULTILINE), (
            done.stdout
        )
