"""The lock, the extras and the build requirements must name the same versions."""

import re
import tomllib
from pathlib import Path

import pytest


def locked(repository: Path) -> list[str]:
    return (repository / "requirements.lock").read_text().splitlines()


def exact(requirements: list[str]) -> set[str]:
    """Return the requirements with one exact version, without their extras."""
    return {re.sub(r"\[.*\]", "", r) for r in requirements if "==" in r}


def test_the_lock_has_only_names_and_versions(repository: Path) -> None:
    lines = locked(repository)
    assert [line for line in lines if not re.fullmatch(r"[a-z0-9-]+==[\w.]+", line)] == []


def test_the_extras_are_pinned_to_the_lock(repository: Path) -> None:
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    wheels = project["optional-dependencies"]["ros-wheels"]
    assert exact(wheels) <= set(locked(repository))
    assert [r for r in wheels if r.startswith("ros-") and "==" not in r] == []


def test_messages_are_compiled_against_their_run_time(repository: Path) -> None:
    build = tomllib.loads((repository / "interfaces" / "pyproject.toml").read_text())
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    assert exact(build["build-system"]["requires"]) <= set(locked(repository))
    assert build["project"]["version"] == project["version"]
    pinned = f"obelisk-interfaces=={build['project']['version']}"
    assert pinned in project["optional-dependencies"]["ros"]


@pytest.mark.parametrize(
    ("extra", "least"),
    [
        # CVE-2024-56326 and CVE-2025-27516: escapes from the sandbox of templates.
        ("", "jinja2>=3.1.6"),
        # PYSEC-2026-248 and PYSEC-2026-249.
        ("web", "starlette>=1.3.1"),
        ("render", "pillow>=12.3"),
    ],
)
def test_no_version_with_known_faults_is_taken(repository: Path, extra: str, least: str) -> None:
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    wanted = project["optional-dependencies"][extra] if extra else project["dependencies"]
    assert least in wanted
