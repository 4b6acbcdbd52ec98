"""`obk schema --install-vscode` writes the schema and keeps the settings."""

import os
from pathlib import Path

import pytest

from obk_cli.cli.main import main

ROOT = Path(__file__).parents[4]
SCHEMA = ROOT / "schema/obelisk.schema.json"
LINE = "# yaml-language-server: $schema="


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    node = "pkg: p\nexecutable: e\npublishers: [{key: a, topic: /a}]\n"
    files = {
        "config/stack.yaml": f"config: s\ncontrol:\n  {node.replace(chr(10), chr(10) + '  ')}",
        "config/whole.yml": "config: s\ninclude: [stack.yaml]\n",
        "config/deep/known.yaml": f"{LINE}anything\nconfig: s\ninclude: [a.yaml]\n",
        "config/rays.yaml": "site_name: a\n",
        "config/broken.yaml": "a: [",
        "build/stack.yaml": "config: s\ninclude: a\n",
        ".hidden/stack.yaml": "config: s\ninclude: a\n",
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text(text)
    return tmp_path


def install(capsys: pytest.CaptureFixture[str], folder: Path) -> tuple[object, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["schema", "--install-vscode", str(folder)])
    out, err = capsys.readouterr()
    return ended.value.code, out.replace(str(folder), "DIR"), err.replace(str(folder), "DIR")


def test_the_schema_is_written_and_the_line_for_each_config_printed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = folder / ".vscode/settings.json"
    settings.parent.mkdir()
    settings.write_text("{ // mine\n}\n")
    code, out, _ = install(capsys, folder)
    assert code == 0
    assert out.splitlines()[0] == "DIR/.vscode/obelisk.schema.json: written"
    assert [line.strip() for line in out.splitlines() if LINE in line] == [
        f"config/stack.yaml: {LINE}../.vscode/obelisk.schema.json",
        f"config/whole.yml: {LINE}../.vscode/obelisk.schema.json",
    ]
    assert (folder / ".vscode/obelisk.schema.json").read_bytes() == SCHEMA.read_bytes()
    assert settings.read_text() == "{ // mine\n}\n"
    assert "obelisk.schema.json: nothing to change\n" in install(capsys, folder)[1]


def test_nothing_is_read_once_every_config_has_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = f"{LINE}.vscode/obelisk.schema.json\n"
    (tmp_path / "a.yaml").write_text(f"{line}config: s\ninclude: [b.yaml]\n")
    assert LINE not in install(capsys, tmp_path)[1]


def test_a_missing_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = install(capsys, tmp_path / "none")
    assert (code, err) == (1, "error: `DIR` is not a folder\n")


def test_a_folder_without_the_option_is_misuse(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["schema", "here"])
    assert ended.value.code == 2
    assert capsys.readouterr().err == "error: DIR is only valid with `--install-vscode`\n"


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*/*.yaml")), ids=lambda p: p.name)
def test_every_example_names_its_schema_for_editors(path: Path) -> None:
    first = path.read_text().splitlines()[0]
    start = "# yaml-language-server: $schema="
    assert first.startswith(start)
    assert (path.parent / first.removeprefix(start)).resolve() == SCHEMA


def test_a_pipe_and_an_endless_file_are_no_configs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(folder / "pipe.yaml")
    (folder / "endless.yaml").symlink_to("/dev/zero")
    code, out, _ = install(capsys, folder)
    assert code == 0
    assert "pipe.yaml" not in out
    assert "endless.yaml" not in out


@pytest.mark.parametrize("link", [".vscode", ".vscode/obelisk.schema.json"])
def test_a_link_that_leads_out_of_the_folder_is_not_followed(
    folder: Path,
    tmp_path_factory: pytest.TempPathFactory,
    capsys: pytest.CaptureFixture[str],
    link: str,
) -> None:
    outside = tmp_path_factory.mktemp("outside")
    (folder / link).parent.mkdir(exist_ok=True)
    (folder / link).symlink_to(outside / "schema.json" if "/" in link else outside)
    code, out, err = install(capsys, folder)
    assert (code, out) == (1, "")
    assert f"is a link to {outside}" in err
    assert list(outside.iterdir()) == []
