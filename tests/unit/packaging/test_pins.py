"""The lock, the extras and the build requirements have to name the same versions."""

import re
import tomllib
from pathlib import Path


def locked(repository: Path) -> list[str]:
    return (repository / "requirements.lock").read_text().splitlines()


def exact(requirements: list[str]) -> set[str]:
    """Return the requirements with one exact version, without their extras."""
    return {re.sub(r"\[.*\]", "", r) for r in requirements if "==" in r}


def test_the_lock_has_names_and_versions_and_nothing_else(repository: Path) -> None:
    lines = locked(repository)
    assert [line for line in lines if not re.fullmatch(r"[a-z0-9-]+==[\w.]+", line)] == []


def test_the_extras_are_pinned_to_what_is_locked(repository: Path) -> None:
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    wheels = project["optional-dependencies"]["ros-wheels"]
    assert exact(wheels) <= set(locked(repository))
    assert [r for r in wheels if r.startswith("ros-") and "==" not in r] == []


def test_messages_are_compiled_against_what_they_run_with(repository: Path) -> None:
    build = tomllib.loads((repository / "interfaces" / "pyproject.toml").read_text())
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    own = {f"obelisk-cli=={project['version']}"}
    assert exact(build["build-system"]["requires"]) - own <= set(locked(repository))
    assert own < exact(build["build-system"]["requires"])
    pinned = f"obelisk-interfaces=={build['project']['version']}"
    assert pinned in project["optional-dependencies"]["ros"]


def test_the_sandbox_of_templates_is_one_without_known_ways_out(repository: Path) -> None:
    """CVE-2024-56326 and CVE-2025-27516 are of those before 3.1.6."""
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    assert "jinja2>=3.1.6" in project["dependencies"]
