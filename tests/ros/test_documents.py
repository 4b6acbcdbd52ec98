"""Every `obk` command that a document shows does what it is shown for."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from .stack import launched, obk

pytestmark = pytest.mark.ros

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = (ROOT / "README.md", ROOT / "examples" / "dummy" / "README.md")
SHELL_BLOCK = re.compile(r"```sh\n(.*?)```", re.DOTALL)


def commands(document: Path) -> list[list[str]]:
    """The arguments of every `obk` command in a document, in its order."""
    lines = "".join(SHELL_BLOCK.findall(document.read_text())).splitlines()
    split = [shlex.split(line, comments=True) for line in lines]
    return [words[1:] for words in split if words and Path(words[0]).name == "obk"]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_commands_of_a_document_work_in_their_order(
    document: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    found = commands(document)
    assert found
    launches = [words for words in found if words[0] == "launch"]
    for words in (w for w in found if w[0] not in ("launch", "lifecycle")):
        assert obk(*words).returncode == 0, words
    with launched(Path(launches[0][1]), *launches[0][2:]) as run:
        for words in (w for w in found if w[0] == "lifecycle"):
            result = obk(*words)
            assert result.returncode == 0, (words, result.stderr)
    assert run.process.returncode == 0, run.text
