"""The command that installs obk from the source of the running one."""

import importlib.metadata
import json
import shlex
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest
from packaging.requirements import Requirement

from obk_cli.install_source import InstallSource, parse_direct_url, read_install_source

COMMIT = "0123456789abcdef0123456789abcdef01234567"
HOST = "https://git.invalid/lab/obelisk.git"


def installed(source: InstallSource, *extras: str) -> list[str]:
    """Return the arguments after `pip install`."""
    words = shlex.split(source.pip_install(*extras))
    assert words[:2] == ["pip", "install"]
    return words[2:]


def git(folder: Path, *arguments: str) -> str:
    identity = ("-c", "user.name=a", "-c", "user.email=a@b.invalid")
    command = ("git", "-C", str(folder), *identity, *arguments)
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """Return a clone whose only commit is on its remote."""
    origin, clone = tmp_path / "origin", tmp_path / "my clone"
    origin.mkdir()
    git(origin, "init", "--quiet")
    git(origin, "commit", "--quiet", "--allow-empty", "--message", "first")
    git(tmp_path, "clone", "--quiet", str(origin), str(clone))
    return clone


def test_a_git_url_keeps_its_commit_and_includes_the_messages() -> None:
    record = {"url": HOST, "vcs_info": {"vcs": "git", "commit_id": COMMIT}}
    tool, messages = map(Requirement, installed(parse_direct_url(record), "ros", "sim"))
    assert (tool.name, tool.extras) == ("obelisk-cli", {"ros", "sim"})
    assert tool.url == f"git+{HOST}@{COMMIT}"
    assert messages.name == "obelisk-interfaces"
    assert messages.url == f"git+{HOST}@{COMMIT}#subdirectory=interfaces"


def test_a_folder_is_installed_as_it_was(tmp_path: Path) -> None:
    folder = tmp_path / "with space"
    record = {"url": folder.as_uri(), "dir_info": {"editable": True}}
    source = parse_direct_url(record)
    assert installed(source) == ["--editable", f"{folder}"]
    assert installed(source, "ros") == ["--editable", f"{folder}[ros]", f"{folder}/interfaces"]
    assert source.is_local


def test_the_messages_are_found_next_to_a_wheel() -> None:
    wheel = "file:///dist/obelisk_cli-0.1.0-py3-none-any.whl"
    source = parse_direct_url({"url": wheel, "archive_info": {}})
    *find, requirement = installed(source, "ros")
    assert find == ["--find-links", "/dist"]
    assert Requirement(requirement).url == wheel
    assert len(installed(source, "sim")) == 1


@pytest.mark.parametrize("place", ["https://dist.invalid", "file:///dist"])
def test_messages_of_an_archive_are_installed_from_theirs(
    monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    urls = {"obelisk-cli": f"{place}/tool.whl", "obelisk-interfaces": f"{place}/messages.tar.gz"}
    monkeypatch.setattr(
        importlib.metadata,
        "distribution",
        lambda name: SimpleNamespace(
            read_text=lambda _: json.dumps({"url": urls[name], "archive_info": {}})
        ),
    )
    source = read_install_source()
    requirements = map(Requirement, installed(source, "ros"))
    assert {each.name: each.url for each in requirements} == urls
    assert source.is_local == place.startswith("file:")


def test_a_git_repository_of_this_machine_is_local() -> None:
    record = {"url": "file:///clone", "vcs_info": {"vcs": "git", "commit_id": COMMIT}}
    assert parse_direct_url(record).is_local


def test_without_a_record_it_came_from_an_index() -> None:
    assert installed(InstallSource(), "sim") == ["obelisk-cli[sim]"]
    assert not InstallSource().is_local


def test_this_obk_is_installed_from_this_checkout(repository: Path) -> None:
    assert read_install_source().folder == repository.resolve()


def test_a_published_commit_can_be_installed_elsewhere(clone: Path) -> None:
    git(clone, "remote", "set-url", "origin", HOST)
    other = InstallSource(folder=clone, is_editable=True).for_other_machines()
    assert other.git == f"git+{HOST}@{git(clone, 'rev-parse', 'HEAD')}"
    assert not other.is_local


@pytest.mark.parametrize("scheme", ["", "file://"])
def test_a_remote_on_this_machine_is_of_no_use_elsewhere(clone: Path, scheme: str) -> None:
    git(clone, "remote", "set-url", "origin", f"{scheme}{clone.parent}/origin")
    source = InstallSource(folder=clone)
    assert source.for_other_machines() == source


def test_an_unpublished_commit_is_installed_from_the_folder(clone: Path) -> None:
    git(clone, "commit", "--quiet", "--allow-empty", "--message", "mine")
    source = InstallSource(folder=clone, is_editable=True)
    assert source.for_other_machines() == InstallSource(folder=clone)


def test_a_folder_in_another_repository_is_not_that_repository(clone: Path) -> None:
    inside = clone / "third_party" / "obelisk"
    inside.mkdir(parents=True)
    assert InstallSource(folder=inside).for_other_machines().folder == inside


@pytest.mark.parametrize(
    ("remote", "url"),
    [
        ("https://user:secret@git.invalid/lab/obelisk.git", HOST),
        ("git@git.invalid:lab/obelisk.git", "ssh://git@git.invalid/lab/obelisk.git"),
        ("ssh://git@git.invalid:22/lab/obelisk", "ssh://git@git.invalid:22/lab/obelisk"),
    ],
)
def test_a_remote_is_converted_to_a_pip_url_without_secrets(
    clone: Path, remote: str, url: str
) -> None:
    git(clone, "remote", "set-url", "origin", remote)
    other = InstallSource(folder=clone).for_other_machines()
    assert other.git.rpartition("@")[0] == f"git+{url}"
