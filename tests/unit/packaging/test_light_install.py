"""`obk` without its extras: no ROS 2, no MuJoCo, no numpy; and its messages about missing ones."""

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from obk_cli.cli.commands import VERBS
from obk_cli.install_source import install_command

LIGHT = {
    "init": ["my_robot"],
    "new": ["controller", "other", "--dest", "my_robot/src"],
    "validate": ["my_robot/my_robot.yaml"],
    "compile": ["my_robot/my_robot.yaml"],
    "graph": ["my_robot/my_robot.yaml"],
    "ps": [],
    "stop": [],
    "logs": [],
    "reap": [],
    "doctor": ["folders"],
    "explain": ["OBK303"],
    "migrate": ["my_robot/my_robot.yaml"],
    "schema": [],
}
"""Command -> arguments with which it needs no extra, in this order."""
NEEDS = {
    "build": ("ros", ["--workspace", "messages"]),
    "launch": ("ros", ["no_file.yaml"]),
    "rehearse": ("ros", ["no_file.yaml"]),
    "lifecycle": ("ros", ["get"]),
    "topic": ("ros", ["list"]),
    "node": ("ros", ["list"]),
    "param": ("ros", ["list"]),
    "service": ("ros", ["list"]),
    "monitor": ("ros", ["--once"]),
    "test": ("test", ["my_robot/my_robot.yaml"]),
    "record": ("record", []),
    "bag": ("record", ["info", "run.mcap"]),
    "diff": ("record", ["one.mcap", "two.mcap"]),
    "export": ("export", ["run.mcap", "--to", "csv"]),
    "play": ("record", ["run.mcap"]),
    "plot": ("plot", ["run.mcap", "est.q"]),
    "sweep": ("test", ["my_robot/my_robot.yaml"]),
    "web": ("web", []),
}
"""Command -> the extra that it needs first, and arguments."""
FAILS_WITHOUT_A_RUN = {"stop", "logs"}

MODEL = ["init", "with_model", "--model", "robot.xml"]

Result = tuple[int, str, str]


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Result]:
    """Command -> its exit code, output and errors, all from one process."""
    reported = {**LIGHT, **{verb: arguments for verb, (_, arguments) in NEEDS.items()}}
    lines = [*([verb, *arguments] for verb, arguments in reported.items()), MODEL]
    folder = tmp_path_factory.mktemp("light")
    package = folder / "messages" / "src" / "my_msgs"
    (package / "msg").mkdir(parents=True)
    (package / "msg" / "Turn.msg").write_text("float64 angle\n")
    manifest = "<package><name>my_msgs</name><version>1.0.0</version></package>"
    (package / "package.xml").write_text(manifest)
    environment = {
        **{name: os.environ[name] for name in ("PATH", "XDG_CACHE_HOME")},
        "HOME": str(folder),
        "OBK_HOME": str(folder / "home"),
    }
    done = subprocess.run(
        [
            sys.executable,
            Path(__file__).with_name("light.py"),
            json.dumps(lines),
        ],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    results = dict(zip((*reported, "model"), json.loads(done.stdout), strict=True))
    return results.__getitem__


def test_every_command_is_tried() -> None:
    assert LIGHT.keys() | NEEDS.keys() == VERBS.keys()


@pytest.mark.parametrize("verb", LIGHT)
def test_a_command_that_needs_no_extra(output: Callable[[str], Result], verb: str) -> None:
    code, out, err = output(verb)
    assert "fault of obk" not in err
    assert "ROS 2 is not available" not in out + err
    assert (code, out != "") == ((1, False) if verb in FAILS_WITHOUT_A_RUN else (0, True)), err


@pytest.mark.parametrize("verb", NEEDS)
def test_a_command_that_needs_one_reports_which_and_how(
    output: Callable[[str], Result], verb: str
) -> None:
    code, out, err = output(verb)
    extra, _ = NEEDS[verb]
    assert (code, out) == (1, "")
    assert err.startswith("error: ")
    assert f"help: install it with `{install_command(extra)}`" in err


def test_a_model_needs_the_simulator(output: Callable[[str], Result]) -> None:
    code, out, err = output("model")
    assert (code, out) == (1, "")
    assert f"help: install it with `{install_command('sim')}`" in err


def test_the_document_agrees(repository: Path) -> None:
    text = (repository / "docs" / "how-to" / "installing.md").read_text()
    _, _, parts = text.partition("\nWithout extras these commands work:")
    listed, _, rest = parts.partition("Every other command")
    assert set(re.findall(r"`(\w+)`", listed)) == LIGHT.keys()
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    rows = re.findall(r"(?m)^\| `([\w-]+)` \| (.*?) \|", rest)
    assert {extra for extra, _ in rows} == project["optional-dependencies"].keys()
    for verb, (extra, _) in NEEDS.items():
        assert re.search(rf"`(obk )?{verb}`", dict(rows)[extra]), verb


def test_a_config_is_checked_but_for_its_model_and_imports_of_ros(
    output: Callable[[str], Result],
) -> None:
    _, out, _ = output("validate")
    assert "info[OBK300]: MuJoCo is not installed" in out
    assert out.count("OBK421") == out.count("info[OBK421]") == 1
