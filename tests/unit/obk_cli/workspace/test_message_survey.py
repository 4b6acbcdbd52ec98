import os
import shutil
import sys
from pathlib import Path

import pytest

from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.workspace.message_build import (
    Survey,
    choose,
    colcon_command,
    find_message_packages,
    refuse_conflicts,
    survey_workspace,
)
from obk_cli.workspace.overlay import (
    BuiltPackage,
    OverlayRecord,
    build_lock,
    new_overlay,
    overlay_folder,
    overlay_prefixes,
    read_record,
    replace_overlay,
)
from obk_interfaces import PackageError

MANIFEST = "<package format='3'><name>{}</name><version>0.1.0</version>{}</package>"


def add(workspace: Path, name: str, *depends: str) -> Path:
    folder = workspace / "src" / name
    (folder / "msg").mkdir(parents=True)
    needed = "".join(f"<depend>{other}</depend>" for other in depends)
    (folder / "package.xml").write_text(MANIFEST.format(name, needed))
    (folder / "msg" / "A.msg").write_text("float64 a\n")
    return folder


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    add(tmp_path, "a_msgs", "b_msgs")
    add(tmp_path, "b_msgs")
    add(tmp_path, "c_msgs")
    (tmp_path / "src" / "node").mkdir()
    (tmp_path / "src" / "node" / "package.xml").write_text(MANIFEST.format("node", ""))
    return tmp_path


def build_as_if(survey: Survey, *names: str) -> None:
    packages = {
        one.name: BuiltPackage(source="", digest=one.digest)
        for one in survey.packages
        if one.name in (names or (one.name,))
    }
    record = OverlayRecord(
        builder="obk", python="3", ros=survey.ros, prefixes=(".",), packages=packages
    )
    with build_lock(survey.workspace, pytest.fail):
        replace_overlay(survey.workspace, new_overlay(survey.workspace, with_current=False), record)


def states(survey: Survey) -> dict[str, str]:
    return {one.name: one.state for one in survey.packages}


def test_packages_with_definitions_follow_their_dependencies(workspace: Path) -> None:
    found, _ = find_message_packages(workspace)
    assert [package.name for package in found] == ["b_msgs", "a_msgs", "c_msgs"]


def test_two_packages_of_one_name_matter_if_they_are_needed(workspace: Path) -> None:
    copy = workspace / "copy"
    shutil.copytree(workspace / "src" / "b_msgs", copy)
    assert survey_workspace(workspace, ()).conflicts == ()
    next(copy.glob("msg/*.msg")).write_text("float64 other\n")
    survey = survey_workspace(workspace, ())
    (conflict,) = survey.conflicts
    assert (conflict.name, {conflict.used, conflict.other}) == (
        "b_msgs",
        {copy, workspace / "src" / "b_msgs"},
    )
    refuse_conflicts(survey, ["c_msgs", "none_msgs"])
    for name in ("b_msgs", "a_msgs"):
        with pytest.raises(PackageError, match="b_msgs"):
            refuse_conflicts(survey, [name])


def test_a_package_that_a_link_leads_to_as_well_is_one_package(workspace: Path) -> None:
    packages, _ = find_message_packages(workspace)
    (workspace / "link").symlink_to(packages[0].root)
    assert find_message_packages(workspace) == (packages, ())


def test_changed_packages_and_their_dependents_are_stale(workspace: Path) -> None:
    survey = survey_workspace(workspace, ())
    assert states(survey) == dict.fromkeys(("b_msgs", "a_msgs", "c_msgs"), "missing")
    build_as_if(survey)
    assert survey_workspace(workspace, ()).is_current
    (workspace / "src" / "b_msgs" / "msg" / "A.msg").write_text("float64 b\n")
    changed = survey_workspace(workspace, ())
    assert states(changed) == {"b_msgs": "changed", "a_msgs": "changed", "c_msgs": "built"}


def test_a_deleted_or_unbuilt_package_makes_the_overlay_stale(workspace: Path) -> None:
    build_as_if(survey_workspace(workspace, ()), "b_msgs", "c_msgs")
    shutil.rmtree(workspace / "src" / "c_msgs")
    survey = survey_workspace(workspace, ())
    assert (states(survey)["a_msgs"], survey.removed) == ("missing", ("c_msgs",))
    assert not survey.is_current


def test_definitions_that_an_underlying_prefix_has_are_not_built(
    workspace: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    below = tmp_path_factory.mktemp("below")
    for name in ("a_msgs", "b_msgs"):
        shutil.copytree(workspace / "src" / name, below / "share" / name)
    survey = survey_workspace(workspace, (below,))
    assert states(survey) == {"b_msgs": "installed", "a_msgs": "installed", "c_msgs": "missing"}
    (workspace / "src" / "b_msgs" / "msg" / "A.msg").write_text("float64 b\n")
    # `a_msgs` below was compiled against the other `b_msgs`.
    survey = survey_workspace(workspace, (below,))
    assert states(survey) == dict.fromkeys(("b_msgs", "a_msgs", "c_msgs"), "missing")


def test_a_name_includes_its_dependencies_and_its_dependents(workspace: Path) -> None:
    survey = survey_workspace(workspace, ())
    assert [one.name for one in choose(survey, ["a_msgs"], present=())] == ["b_msgs", "a_msgs"]
    assert [one.name for one in choose(survey, ["b_msgs"], present=())] == ["b_msgs"]
    with_user = choose(survey, ["b_msgs"], present=("a_msgs",))
    assert [one.name for one in with_user] == ["b_msgs", "a_msgs"]
    assert len(choose(survey, (), present=())) == 3


def test_an_unknown_package_name_is_reported_with_similar_ones(workspace: Path) -> None:
    with pytest.raises(MisuseError) as refused:
        choose(survey_workspace(workspace, ()), ["c_mgs"], present=())
    assert refused.value.message == f"no message package is named `c_mgs` in {workspace}"
    assert (refused.value.help or "").startswith("did you mean `c_msgs`")


def test_colcon_is_called_with_arguments_not_a_line() -> None:
    assert colcon_command("colcon", ["a", "b"], jobs=3) == (
        *("colcon", "build", "--parallel-workers", "3"),
        *("--packages-select", "a", "b"),
    )


def test_a_new_overlay_replaces_the_old_one_completely(workspace: Path) -> None:
    survey = survey_workspace(workspace, ())
    build_as_if(survey)
    first = overlay_folder(workspace).resolve()
    (first / "share").mkdir()
    (first / "share" / "kept").write_text("x")
    with build_lock(workspace, pytest.fail):
        stage = new_overlay(workspace, with_current=True)
        assert (stage / "share" / "kept").samefile(first / "share" / "kept")
        record = read_record(workspace)
        assert record is not None
        replace_overlay(workspace, stage, record)
    assert overlay_folder(workspace).resolve() == stage
    assert not first.exists()
    assert (workspace / ".obk" / ".gitignore").read_text().endswith("*\n")
    assert overlay_prefixes((workspace,)) == (overlay_folder(workspace),)


def test_leftovers_of_a_killed_build_are_removed_by_the_next(workspace: Path) -> None:
    build_as_if(survey_workspace(workspace, ()))
    with build_lock(workspace, pytest.fail):
        left = new_overlay(workspace, with_current=True)
    with build_lock(workspace, pytest.fail):
        assert not left.exists()
        assert overlay_folder(workspace).is_dir()


@pytest.mark.parametrize("text", ["", "[]", "{", '{"packages": 3}', '{"packages": {"a": 1}}'])
def test_an_unreadable_record_is_none(workspace: Path, text: str) -> None:
    build_as_if(survey_workspace(workspace, ()))
    (overlay_folder(workspace) / "overlay.json").write_text(text)
    assert read_record(workspace) is None
    assert overlay_prefixes((workspace,)) == ()
    assert len(survey_workspace(workspace, (Path(sys.prefix),)).stale) == 3


def test_another_build_is_reported_of_and_not_waited_for_without_end(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("obk_cli.workspace.overlay.TURN_S", 0.0)
    reported: list[str] = []
    message = f"process {os.getpid()} has been building for 0 min"
    with (
        build_lock(workspace, pytest.fail),
        pytest.raises(CommandFailedError, match=message),
        build_lock(workspace, reported.append),
    ):
        pytest.fail("two build at once")
    assert reported == [f"waiting for process {os.getpid()}, which is building in this workspace"]
