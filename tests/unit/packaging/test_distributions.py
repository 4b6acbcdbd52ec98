"""The contents of the two distributions, as found by their builder; `make wheel` tries them."""

import re
import subprocess
from pathlib import Path

import pytest
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder


@pytest.fixture(scope="module")
def kept(repository: Path) -> set[str]:
    """The files in git."""
    if not (repository / ".git").exists():
        pytest.skip("what git keeps is known in a checkout only")
    listing = subprocess.run(
        ["git", "ls-files", "-z"], cwd=repository, capture_output=True, text=True, check=True
    )
    return {name for name in listing.stdout.split("\0") if (repository / name).is_file()}


def in_sdist(root: Path) -> set[str]:
    found = {file.relative_path for file in SdistBuilder(str(root)).recurse_included_files()}
    return found | {"pyproject.toml", ".gitignore"}  # the builder always adds it


def test_a_source_distribution_has_every_file_that_git_keeps(
    repository: Path, kept: set[str]
) -> None:
    assert kept - in_sdist(repository) == set()


def test_a_wheel_has_every_file_below_src(repository: Path, kept: set[str]) -> None:
    builder = WheelBuilder(str(repository))
    packed = {f"src/{file.distribution_path}" for file in builder.recurse_included_files()}
    assert {name for name in kept if name.startswith("src/")} - packed == set()
    assert not any("__pycache__" in name for name in packed)


def test_both_carry_the_licence(repository: Path) -> None:
    licence = (repository / "LICENSE").read_text()
    assert (repository / "interfaces" / "LICENSE").read_text() == licence
    for root in (repository, repository / "interfaces"):
        assert WheelBuilder(str(root)).metadata.core.license_files == ["LICENSE"]
        assert "LICENSE" in in_sdist(root)


def test_the_pages_of_an_index_have_no_link_into_the_checkout(repository: Path) -> None:
    for root in (repository, repository / "interfaces"):
        core = WheelBuilder(str(root)).metadata.core
        assert core.readme_content_type == "text/markdown"
        targets = re.findall(r"\]\(([^)]*)\)", core.readme)
        assert [target for target in targets if not target.startswith("https://")] == []


def test_the_page_of_an_index_names_existing_extras(repository: Path) -> None:
    core = WheelBuilder(str(repository)).metadata.core
    (named,) = re.findall(r"pip install 'obelisk-cli\[(.+)\]'", core.readme)
    assert set(named.split(",")) <= core.optional_dependencies.keys()
