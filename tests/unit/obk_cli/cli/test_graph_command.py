"""`obk graph`: content and destination of its output."""

from pathlib import Path

import pytest

from obk_cli.cli.main import main
from obk_cli.compiler import Options, compile_config
from obk_cli.emit.formats import FORMS

CONFIG = str(Path(__file__).resolve().parents[3] / "cases/accept/OBK004/topic_twice.yaml")


def graph(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["graph", CONFIG, "--ignore", "OBK4", *arguments])
    return ended.value.code if isinstance(ended.value.code, int) else -1


def test_without_options_it_is_drawn_for_eighty_columns(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    assert graph() == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "arm: 3 nodes, 3 topics"
    assert max(map(len, lines)) == 80


@pytest.mark.parametrize(
    ("name", "form"), [("x.svg", "svg"), ("x.dot", "dot"), ("x.mmd", "mermaid")]
)
def test_the_output_name_selects_the_format(tmp_path: Path, name: str, form: str) -> None:
    assert graph("--output", str(tmp_path / name)) == 0
    options = Options(variables={}, working_folder=Path.cwd(), ignore=("OBK4",))
    plan = compile_config(CONFIG, options).plan
    assert plan is not None
    assert (tmp_path / name).read_text() == FORMS[form].emit(plan)


def test_a_png_is_drawn_into_a_file_or_printed(
    tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    assert graph("--output", str(tmp_path / "x.png")) == 0
    picture = (tmp_path / "x.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert graph("--to", "png", "--output", "-") == 0
    assert capfdbinary.readouterr().out == picture


def test_a_dash_is_the_standard_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config = str(Path(CONFIG).resolve())
    monkeypatch.chdir(tmp_path)
    for to in (["graph"], ["graph", "--to", "dot"], ["compile"]):
        with pytest.raises(SystemExit):
            main([*to, config, "--ignore", "OBK4"])
        printed = capsys.readouterr().out
        with pytest.raises(SystemExit):
            main([*to, config, "--ignore", "OBK4", "--output", "-"])
        assert capsys.readouterr().out == printed
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["arm.yaml", "base.yaml", "name.yaml", "link.yaml"])
def test_the_output_replaces_no_input(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, base = tmp_path / "arm.yaml", tmp_path / "base.yaml"
    base.write_bytes(Path(CONFIG).read_bytes())
    (tmp_path / "name.yaml").write_text("config: other\n")
    config.write_text("include: [base.yaml, name.yaml]\n")
    (tmp_path / "link.yaml").symlink_to(config)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(SystemExit) as ended:
        main(["compile", str(config), "--ignore", "OBK4", "--output", str(tmp_path / name)])
    assert ended.value.code == 2
    assert name in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_form_that_is_no_picture_is_misuse(capsys: pytest.CaptureFixture[str]) -> None:
    assert graph("--to", "params") == 2
    assert "expected one of `mermaid`, `dot`, `svg`, `png`" in capsys.readouterr().err


def test_the_format_must_fit_the_extension(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("x.png", "x.PNG"):
        path = tmp_path / name
        assert graph("--to", "svg", "--output", str(path)) == 2
        assert name in capsys.readouterr().err
        assert not path.exists()
    assert graph("--to", "dot", "--output", str(tmp_path / "x.gv")) == 0


def test_an_empty_output_name_is_misuse(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert graph("--to", "svg", "--output", "") == 2
    assert "`--output`" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_config_with_errors_is_not_drawn(capsys: pytest.CaptureFixture[str]) -> None:
    assert graph("--set", "robot.pkg=") == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert "error[OBK" in err
