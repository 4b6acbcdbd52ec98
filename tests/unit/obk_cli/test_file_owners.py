"""Files by another user in world-writable folders are never run."""

import json
import os
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.files import is_untrusted
from obk_cli.launch.run_lock import claim_run
from obk_cli.process.identity import this_process
from obk_cli.runs.folder import Run
from obk_cli.runs.registry import live_folders
from obk_cli.workspace.overlay import FOLDER, RECORD, build_lock, overlay_prefixes
from obk_cli.workspace.package_index import PackageIndex, is_workspace, package_names_in

ANOTHER = 54321
"""The ID of a user other than this one and root."""
BUILT = {"source": "demo_msgs", "digest": "1"}
REPORTED = {
    "builder": "obk",
    "python": "3",
    "ros": "/",
    "prefixes": ["."],
    "packages": {"m": BUILT},
}

Give = Callable[[Path], None]


@pytest.fixture
def shared(tmp_path: Path) -> Path:
    """A folder such as /tmp, which contains one of this user's folders."""
    folder = tmp_path / "shared"
    (folder / "mine").mkdir(parents=True)
    folder.chmod(0o1777)
    return folder


@pytest.fixture
def give_away(monkeypatch: pytest.MonkeyPatch) -> Give:
    """Make a file appear to belong to another user."""

    def give(path: Path) -> None:
        if os.geteuid() == 0:
            os.lchown(path, ANOTHER, ANOTHER)
        else:
            monkeypatch.setattr(os, "geteuid", lambda: ANOTHER)

    return give


def package(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "package.xml").write_text("<package><name>demo</name></package>")
    return folder


def overlay(workspace: Path) -> Path:
    """An overlay with a package."""
    folder = workspace / FOLDER / "overlay"
    folder.mkdir(parents=True)
    (folder / RECORD).write_text(json.dumps(REPORTED))
    return folder


def test_in_a_world_writable_folder_files_belong_to_their_owners(
    shared: Path, give_away: Give
) -> None:
    (shared / "link").symlink_to("mine")
    assert not is_untrusted(shared / "mine")
    assert not is_untrusted(shared / "nothing")
    give_away(shared / "link")
    assert is_untrusted(shared / "link")
    shared.chmod(0o755)
    assert not is_untrusted(shared / "link")


@pytest.mark.parametrize("mark", [".git", "src"])
def test_it_makes_no_workspace(shared: Path, give_away: Give, mark: str) -> None:
    (shared / mark).mkdir()
    assert is_workspace(shared)
    give_away(shared / mark)
    assert not is_workspace(shared)


def test_it_is_no_package_next_to_a_config(shared: Path, give_away: Give) -> None:
    package(shared / "demo")
    assert package_names_in(shared) == ("demo",)
    give_away(shared / "demo")
    assert package_names_in(shared) == ()


def test_it_is_no_package_around_a_config(shared: Path, give_away: Give) -> None:
    package(shared)
    assert package_names_in(shared) == ("demo",)
    give_away(shared / "package.xml")
    assert package_names_in(shared) == ()


def test_it_is_no_overlay(shared: Path, give_away: Give) -> None:
    folder = overlay(shared)
    assert overlay_prefixes([shared]) == (folder,)
    give_away(shared / FOLDER)
    assert overlay_prefixes([shared]) == ()
    assert folder not in PackageIndex.around(shared, shared, {}).prefixes
    with (
        pytest.raises(CommandFailedError, match=r"\.obk belongs to another user"),
        build_lock(shared, print),
    ):
        pass


def test_in_a_private_folder_files_of_any_owner_are_used(shared: Path, give_away: Give) -> None:
    package(shared / "mine" / "demo")
    give_away(shared / "mine" / "demo")
    assert package_names_in(shared / "mine") == ("demo",)


def test_it_cannot_contain_runs_and_its_runs_are_ignored(shared: Path, give_away: Give) -> None:
    runs = shared / "logs" / "runs"
    pid, started = this_process()
    run = Run(name="s", pid=pid, started=started, domain=80, config="c.yaml", nodes=("/a",))
    folder = claim_run(runs, run, datetime(2031, 2, 3, 4, 5, 6))
    assert list(live_folders(runs)) == [folder]
    give_away(shared / "logs")
    assert live_folders(runs) == {}
    with pytest.raises(PermissionError, match="it belongs to another user"):
        claim_run(runs, run, datetime(2031, 2, 3, 4, 5, 7))
