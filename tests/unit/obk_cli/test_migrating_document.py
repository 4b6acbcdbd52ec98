"""docs/how-to/migrating.md says what is true: its example and its commands."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from obk_cli.cli.main import main
from obk_cli.configedit.migrate import migrate_source
from obk_cli.diagnostics.source import SourceFile

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs/how-to/migrating.md").read_text()


def test_the_older_spelling_of_the_document_becomes_the_newer_one() -> None:
    older, newer = re.findall(r"```yaml\n(config: .*?)```", TEXT, re.DOTALL)
    assert migrate_source(SourceFile.of("arm.yaml", older), "key").text == newer


def test_the_commands_of_the_document_work_in_their_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    shutil.copytree(ROOT / "ros_packages", tmp_path / "src")
    monkeypatch.chdir(tmp_path)
    lines = "".join(re.findall(r"```sh\n(.*?)```", TEXT, re.DOTALL)).splitlines()
    for line in lines:
        with pytest.raises(SystemExit) as ended:
            main(shlex.split(line, comments=True)[1:])
        assert ended.value.code == 0, (line, capfdbinary.readouterr())
    assert len(lines) == 7
