"""Every `obk` command that a document shows does what it is shown for, and `cp` beside it."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from .opengl import require_opengl
from .stack import calm, launched, obk

pytestmark = [pytest.mark.ros, pytest.mark.timeout(600)]

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = (
    ROOT / "README.md",
    ROOT / "examples" / "arm" / "README.md",
    ROOT / "examples" / "dummy" / "README.md",
    ROOT / "examples" / "quadruped" / "README.md",
    ROOT / "docs" / "how-to" / "ci.md",
    ROOT / "docs" / "how-to" / "from-launch-files.md",
    ROOT / "docs" / "reference" / "compile.md",
    ROOT / "docs" / "how-to" / "doctor.md",
    ROOT / "docs" / "how-to" / "viewing.md",
    ROOT / "docs" / "how-to" / "looking-into-a-stack.md",
    ROOT / "docs" / "how-to" / "own-messages.md",
    ROOT / "docs" / "how-to" / "running.md",
)
WHILE_RUNNING = (
    "lifecycle",
    "ps",
    "logs",
    "stop",
    "topic",
    "node",
    "param",
    "service",
    "monitor",
)
SHELL_BLOCK = re.compile(r"```sh\n(.*?)```", re.DOTALL)


def commands(document: Path) -> list[list[str]]:
    """Every `obk` and `cp` command in a document, as words, in its order."""
    text = "".join(SHELL_BLOCK.findall(document.read_text()))
    lines = text.replace("\\\n", " ").splitlines()
    split = [shlex.split(line, comments=True) for line in lines]
    return [words for words in split if words and Path(words[0]).name in ("obk", "cp")]


ROBOTS = {"arm", "quadruped"}
AT_ONCE = ("README.md", "ci.md", "compile.md", "from-launch-files.md", "own-messages.md")
"""What `make test` runs; the others launch what these and the tests of stacks launch as well."""
SHOWN = [
    pytest.param(
        document,
        id=str(document.relative_to(ROOT)),
        marks=[]
        if ROBOTS.isdisjoint(document.parts) and document.name in AT_ONCE
        else pytest.mark.slow,
    )
    for document in DOCUMENTS
    if commands(document)
]


@pytest.mark.parametrize("document", SHOWN)
def test_the_commands_of_a_document_work_in_their_order(
    document: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if any("--render" in words for words in commands(document)):
        require_opengl()
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    calm(tmp_path / "examples" / "dummy")
    shutil.copytree(ROOT / "schema", tmp_path / "schema")
    monkeypatch.chdir(tmp_path)
    found = commands(document)
    launches = [words for words in found if words[1] == "launch"]
    if not launches and any(words[1] in WHILE_RUNNING for words in found):
        launches = [["obk", "launch", "examples/dummy/dummy.yaml"]]
    for words in (w for w in found if w[1] not in ("launch", *WHILE_RUNNING)):
        if words[0] == "cp":
            shutil.copytree(words[2], words[3])
        else:
            result = obk(*words[1:])
            assert result.returncode == 0, (words, result.stdout, result.stderr)
    for launch in launches:
        with launched(Path(launch[2]), *launch[3:]) as run:
            for words in (w for w in found if w[1] in WHILE_RUNNING):
                result = obk(*words[1:])
                assert result.returncode == 0, (words, result.stderr)
        assert run.process.returncode == 0, run.text
