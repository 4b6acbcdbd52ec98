"""All files repeat the version of the project, and `make release` changes it everywhere."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from obk_cli.cli.main import main

TOOLS = ("release.py", "generated.py")
COPIED = ("pyproject.toml", "CHANGELOG.md", "interfaces", "ros_packages", "docs/how-to")
HEADING = re.compile(r"(?m)^## \[(.+?)\](?: - (\d{4}-\d\d-\d\d))?$")


def project_version(root: Path) -> str:
    found = re.search(r'(?m)^version = "(.+)"$', (root / "pyproject.toml").read_text())
    assert found is not None
    return found[1]


def versions(root: Path) -> list[str]:
    """All versions of the project in a checkout."""
    files = [
        *root.glob("*.toml"),
        *root.glob("interfaces/*.toml"),
        *root.glob("*/*/package.xml"),
    ]
    pattern = r'(?m)^version = "(.+)"$|"obelisk-[a-z]+==([\d.]+)"|<version>(.+)</version>'
    return ["".join(groups) for file in files for groups in re.findall(pattern, file.read_text())]


def test_every_file_has_the_version_of_the_project(repository: Path) -> None:
    found = versions(repository)
    assert len(found) == 10
    assert set(found) == {project_version(repository)}


def test_the_changelog_has_the_version_as_released_or_upcoming(repository: Path) -> None:
    text = (repository / "CHANGELOG.md").read_text()
    (first, undated), *released = HEADING.findall(text)
    assert (first, undated) == ("Unreleased", "")
    version = project_version(repository)
    if released:
        assert released[0][0] == version
        assert all(date for _, date in released)
    else:
        assert f"The first version, to become {version}.\n" in text


def test_obk_reports_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert re.fullmatch(r"obk \d+\.\d+\.\d+\n", capsys.readouterr().out)


@pytest.fixture
def checkout(repository: Path, tmp_path: Path) -> Path:
    for name in TOOLS:
        (tmp_path / "tools").mkdir(exist_ok=True)
        shutil.copy(repository / "tools" / name, tmp_path / "tools")
    for name in COPIED:
        source = repository / name
        if source.is_dir():
            shutil.copytree(source, tmp_path / name, ignore=shutil.ignore_patterns("build"))
        else:
            shutil.copy(source, tmp_path)
    return tmp_path


def release(checkout: Path, version: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, checkout / "tools" / "release.py", version]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_release_sets_all_versions_and_dates_the_unreleased_entries(
    checkout: Path,
) -> None:
    before = (checkout / "CHANGELOG.md").read_text()
    assert release(checkout, "7.8.9").returncode == 0
    assert versions(checkout) == ["7.8.9"] * 10
    after = (checkout / "CHANGELOG.md").read_text()
    (unreleased, _), (version, date), *_ = HEADING.findall(after)
    assert (unreleased, version) == ("Unreleased", "7.8.9")
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", date)
    assert "to become" not in after
    assert before.partition("### Added")[2] == after.partition("### Added")[2]


def test_an_invalid_or_old_version_or_an_empty_changelog_changes_nothing(
    checkout: Path,
) -> None:
    release(checkout, "7.8.9")
    text = (checkout / "pyproject.toml").read_text()
    for version, complaint in (
        ("8.0", "release: `8.0` is not a version such as 0.2.0\n"),
        ("7.8.9", "release: 7.8.9 is not newer than 7.8.9, the last release\n"),
        ("7.8.8", "release: 7.8.8 is not newer than 7.8.9, the last release\n"),
        ("7.9.0", "release: CHANGELOG.md has no entries under `Unreleased`\n"),
    ):
        done = release(checkout, version)
        assert (done.returncode, done.stderr) == (1, complaint)
    assert (checkout / "pyproject.toml").read_text() == text
