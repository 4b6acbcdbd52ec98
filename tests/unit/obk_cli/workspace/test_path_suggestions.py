from pathlib import Path

import pytest

from obk_cli.workspace.config_files import did_you_mean_config


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workspace with configs, set as the working folder."""
    for name in ("arm.yaml", "arm_test.yml", "configs/dog.yaml", "build/dot.yaml", ".obk/dog.yaml"):
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.touch()
    (tmp_path / "src").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("written", "suggestion"),
    [
        ("amr.yaml", "did you mean `arm.yaml`?"),
        ("arm", "did you mean `arm.yaml`?"),
        ("arm.yml", "did you mean `arm.yaml`?"),
        ("arm_tst.yaml", "did you mean `arm_test.yml` or `arm.yaml`?"),
        ("dog.yaml", "did you mean `configs/dog.yaml`?"),
        ("configs/arm.yaml", "did you mean `arm.yaml`?"),
        ("zzz.yaml", "available: `arm.yaml`, `arm_test.yml`"),
        ("none/zzz.yaml", None),
        ("configs", None),
        ("-", None),
        ("", None),
    ],
)
def test_a_missing_path_gets_a_suggestion(
    workspace: Path, written: str, suggestion: str | None
) -> None:
    assert did_you_mean_config(written) == suggestion


def test_from_elsewhere_a_config_of_the_workspace_is_reported_in_full(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(workspace / "src")
    assert did_you_mean_config("dog.yaml") == f"did you mean `{workspace}/configs/dog.yaml`?"
    assert did_you_mean_config("../amr.yaml") == "did you mean `../arm.yaml`?"
