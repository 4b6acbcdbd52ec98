"""A model that crashes MuJoCo gives a finding with the file."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NoReturn

import pytest

from obk_cli.config.environment import ModelFault, ModelRead
from obk_cli.workspace import model_reader
from obk_cli.workspace.model_reader import read_model_bounded

pytestmark = pytest.mark.mujoco

MODEL = Path(__file__).parents[4] / "examples" / "dummy" / "dummy.xml"


def test_a_valid_model_has_its_facts() -> None:
    read = read_model_bounded(MODEL)
    assert isinstance(read, ModelRead)
    assert read.fault is None
    assert read.facts.keyframes == ("ic", "other")


IN_C_LOCALE = """
from pathlib import Path
from obk_cli.workspace.model_reader import read_model_bounded
print(type(read_model_bounded(next(Path().glob("*/dummy.xml")))).__name__)
"""


def test_a_path_that_the_locale_cannot_decode_is_read(tmp_path: Path) -> None:
    (tmp_path / "ü").mkdir()
    shutil.copy(MODEL, tmp_path / "ü")
    locale = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(
        [sys.executable, "-c", IN_C_LOCALE],
        cwd=tmp_path,
        env={**os.environ, **locale},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    assert done.stdout == "ModelRead\n"


def test_warnings_of_mujoco_are_not_written_to_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "nan.xml"
    model.write_text('<mujoco><worldbody><body pos="nan 0 0"/></worldbody></mujoco>')
    monkeypatch.chdir(tmp_path)
    read_model_bounded(model)
    assert list(tmp_path.iterdir()) == [model]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGABRT])
def test_a_crash_is_a_fault_of_the_model(
    monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    monkeypatch.setattr(model_reader, "read_model", lambda _: os.kill(os.getpid(), number))
    fault = read_model_bounded(MODEL)
    assert fault == ModelFault(message=f"MuJoCo crashed while reading it ({number.name})")


def test_an_internal_exception_is_not_swallowed(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: Path) -> NoReturn:
        raise RecursionError

    monkeypatch.setattr(model_reader, "read_model", fail)
    fault = read_model_bounded(MODEL)
    assert fault == ModelFault(message="MuJoCo crashed while reading it (exit code 1)")


def test_an_endless_model_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_reader, "_DEADLINE_S", 1)
    monkeypatch.setattr(model_reader, "read_model", lambda _: time.sleep(1000))
    fault = read_model_bounded(MODEL)
    assert fault == ModelFault(message="MuJoCo did not read it within 1 s")


@pytest.mark.parametrize("name", ["pipe", "endless", "folder"])
def test_special_files_are_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "endless").symlink_to("/dev/zero")
    (tmp_path / "folder").mkdir()
    model = tmp_path / "m.xml"
    model.write_text(f'<mujoco><include file="{name}"/></mujoco>')
    fault = read_model_bounded(model)
    assert fault == ModelFault(message=f"`{tmp_path}/{name}` is not a regular file")
