"""The recording that the name of a file or a run refers to."""

from pathlib import Path

import pytest

from obelisk_recordings.bag import RecordingError
from obelisk_recordings.find import RECORDING, find_recording


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    parent = tmp_path / "runs"
    for name in ("arm_20260101_000000", "leg_20260102_000000"):
        (parent / name).mkdir(parents=True)
        (parent / name / RECORDING).touch()
    (parent / "arm_20260103_000000").mkdir()
    (parent / "head_20260104_000000").mkdir()
    return parent


def test_a_file_is_itself_and_a_folder_the_one_in_it(runs: Path) -> None:
    folder = runs.parent / "bag"
    folder.mkdir()
    (folder / "bag_0.mcap").touch()
    assert find_recording(runs, "bag/bag_0.mcap") == Path("bag/bag_0.mcap")
    assert find_recording(runs, "bag") == Path("bag/bag_0.mcap")


def test_a_run_is_named_by_config_or_folder_and_the_most_recent_recorded_is_the_default(
    runs: Path,
) -> None:
    assert find_recording(runs, "arm").parent.name == "arm_20260101_000000"
    assert find_recording(runs, "leg_20260102_000000").parent.name == "leg_20260102_000000"
    assert find_recording(runs, None).parent.name == "leg_20260102_000000"


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("head", "`head`"),
        ("arn", "`arm`"),
        (None, "obk launch --record"),
    ],
)
def test_a_missing_recording_is_reported_with_a_hint(
    runs: Path, name: str | None, expected: str
) -> None:
    if name is None:
        runs = runs.parent
    with pytest.raises(RecordingError) as error:
        find_recording(runs, name)
    assert expected in f"{error.value.message} {error.value.help}"


def test_an_impossible_name_is_that_of_no_file(runs: Path) -> None:
    with pytest.raises(RecordingError, match="`aaa"):
        find_recording(runs, "a" * 300)


def test_the_runs_before_the_latest_have_numbers(runs: Path) -> None:
    for day in ("05", "06"):
        folder = runs / f"arm_202601{day}_000000"
        folder.mkdir()
        (folder / RECORDING).touch()
    found = [find_recording(runs, name).parent.name[:12] for name in ("arm", "arm~1", "arm~2")]
    assert found == ["arm_20260106", "arm_20260105", "arm_20260101"]
    with pytest.raises(RecordingError, match="only 3 runs of `arm` recorded"):
        find_recording(runs, "arm~3")
