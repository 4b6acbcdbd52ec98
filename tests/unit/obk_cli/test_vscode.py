"""`obk schema --install-vscode`: the association is there, what was there stays."""

import json
import os
from pathlib import Path

import pytest

from obk_cli.cli.main import main
from obk_cli.jsonc import read_jsonc

ROOT = Path(__file__).parents[3]
SCHEMA = ROOT / "schema/obelisk.schema.json"
KEY = "./.vscode/obelisk.schema.json"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    node = "pkg: p\nexecutable: e\npublishers: [{key: a, topic: /a}]\n"
    files = {
        "config/stack.yaml": f"config: s\ncontrol:\n  {node.replace(chr(10), chr(10) + '  ')}",
        "config/whole.yml": "config: s\ninclude: [stack.yaml]\n",
        "config/rays.yaml": "site_name: a\n",
        "config/broken.yaml": "a: [",
        "build/stack.yaml": "config: s\ninclude: a\n",
        ".hidden/stack.yaml": "config: s\ninclude: a\n",
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return tmp_path


def install(capsys: pytest.CaptureFixture[str], folder: Path) -> tuple[object, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["schema", "--install-vscode", str(folder)])
    out, err = capsys.readouterr()
    return ended.value.code, out.replace(str(folder), "DIR"), err.replace(str(folder), "DIR")


def test_everything_that_the_editor_needs_is_written_once(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = install(capsys, folder)
    assert code == 0
    assert out == (
        "DIR/.vscode/obelisk.schema.json: written\n"
        "DIR/.vscode/settings.json: written\n"
        "DIR/.vscode/extensions.json: written\n"
        "checked while you write: config/stack.yaml, config/whole.yml, *.obelisk.yaml\n"
    )
    home = folder / ".vscode"
    assert (home / "obelisk.schema.json").read_bytes() == SCHEMA.read_bytes()
    assert json.loads((home / "settings.json").read_text()) == {
        "yaml.schemas": {KEY: ["config/stack.yaml", "config/whole.yml", "*.obelisk.yaml"]}
    }
    assert json.loads((home / "extensions.json").read_text()) == {
        "recommendations": ["redhat.vscode-yaml"]
    }
    assert install(capsys, folder)[1].count("nothing to change") == 3


def test_settings_and_comments_that_are_there_stay(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = folder / ".vscode/settings.json"
    settings.parent.mkdir()
    settings.write_text(f'{{\n  // mine\n  "yaml.schemas": {{"{KEY}": "mine/*.yaml"}},\n}}\n')
    assert install(capsys, folder)[0] == 0
    text = settings.read_text()
    assert "  // mine\n" in text
    assert read_jsonc(text) == {
        "yaml.schemas": {
            KEY: ["mine/*.yaml", "config/stack.yaml", "config/whole.yml", "*.obelisk.yaml"]
        }
    }


def test_settings_that_cannot_be_merged_are_left_and_the_addition_is_told(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = folder / ".vscode/settings.json"
    settings.parent.mkdir()
    settings.write_text('{"yaml.schemas": 1}\n')
    code, out, err = install(capsys, folder)
    assert (code, out) == (1, "")
    assert err == (
        "error: `DIR/.vscode/settings.json` cannot be merged: `yaml.schemas` is no object\n"
        '  help: add to it by hand: "yaml.schemas": {"./.vscode/obelisk.schema.json": '
        '["config/stack.yaml", "config/whole.yml", "*.obelisk.yaml"]}\n'
    )
    assert [path.name for path in settings.parent.iterdir()] == ["settings.json"]


def test_a_folder_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = install(capsys, tmp_path / "none")
    assert (code, err) == (1, "error: `DIR` is no folder\n")


def test_a_folder_without_the_option_is_misuse(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["schema", "here"])
    assert ended.value.code == 2
    assert capsys.readouterr().err == "error: a folder goes with `--install-vscode` only\n"


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*/*.yaml")), ids=lambda p: p.name)
def test_every_example_names_its_schema_for_editors(path: Path) -> None:
    first = path.read_text().splitlines()[0]
    start = "# yaml-language-server: $schema="
    assert first.startswith(start)
    assert (path.parent / first.removeprefix(start)).resolve() == SCHEMA


def test_a_pipe_and_a_file_without_an_end_are_no_configs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(folder / "pipe.yaml")
    (folder / "endless.yaml").symlink_to("/dev/zero")
    code, out, _ = install(capsys, folder)
    assert code == 0
    assert out.endswith("config/stack.yaml, config/whole.yml, *.obelisk.yaml\n")


@pytest.mark.parametrize("link", [".vscode", ".vscode/settings.json"])
def test_a_link_that_leads_out_of_the_folder_is_not_followed(
    folder: Path,
    tmp_path_factory: pytest.TempPathFactory,
    capsys: pytest.CaptureFixture[str],
    link: str,
) -> None:
    outside = tmp_path_factory.mktemp("outside")
    (folder / link).parent.mkdir(exist_ok=True)
    (folder / link).symlink_to(outside / "settings.json" if "/" in link else outside)
    code, out, err = install(capsys, folder)
    assert (code, out) == (1, "")
    assert f"out of the folder, to {outside}" in err
    assert list(outside.iterdir()) == []
