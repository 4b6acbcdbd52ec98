"""The `obk migrate` command: output streams, written files, exit codes."""

import codecs
import io
import stat
from pathlib import Path
from types import SimpleNamespace

import pytest

from obk_cli.cli.main import main
from obk_cli.configedit.edited_files import EditedFile, open_for_edit, write_edited
from obk_cli.errors import CommandFailedError

SEED = b"onboard:\n  robot:\n    publishers:\n    - ros_parameter: a_setting  # \xc3\xa4\n"
KEY = b"robot:\n  publishers:\n  - key: a  # \xc3\xa4\n"


class Result:
    """One run of `obk migrate`, with its output as bytes."""

    def __init__(self, capfdbinary: pytest.CaptureFixture[bytes], *arguments: str) -> None:
        with pytest.raises(SystemExit) as ended:
            main(["migrate", *arguments])
        self.code = ended.value.code
        self.out, err = capfdbinary.readouterr()
        self.err = err.decode()


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = Path("c.yaml")
    path.write_bytes(SEED)
    return path


def test_the_result_goes_to_stdout_and_the_file_is_kept(
    config: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    result = Result(capfdbinary, "c.yaml")
    assert (result.code, result.out, result.err) == (0, KEY, "")
    assert config.read_bytes() == SEED


def test_diff(config: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    result = Result(capfdbinary, "c.yaml", "--diff")
    assert result.code == 0
    assert result.out.decode() == (
        "--- a/c.yaml\n+++ b/c.yaml\n@@ -1,4 +1,3 @@\n"
        "-onboard:\n-  robot:\n-    publishers:\n-    - ros_parameter: a_setting  # ä\n"
        "+robot:\n+  publishers:\n+  - key: a  # ä\n"
    )


def test_a_diff_of_an_absolute_path_has_one_slash(
    config: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    path = config.absolute()
    shown = Result(capfdbinary, str(path), "--diff").out.decode()
    assert shown.startswith(f"--- a{path}\n+++ b{path}\n")


def test_write_and_back(config: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    config.chmod(0o640)
    assert Result(capfdbinary, "c.yaml", "--write").out == b"c.yaml: migrated\n"
    assert config.read_bytes() == KEY
    assert stat.S_IMODE(config.stat().st_mode) == 0o640
    assert Result(capfdbinary, "c.yaml", "--write").out == b"c.yaml: nothing to change\n"
    assert Result(capfdbinary, "c.yaml", "--write", "--to", "seed").code == 0
    assert config.read_bytes() == SEED
    assert [path.name for path in Path().iterdir()] == ["c.yaml"]


def test_a_symbolic_link_is_kept(config: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    link = Path("link.yaml")
    link.symlink_to(config)
    assert Result(capfdbinary, "link.yaml", "--write").code == 0
    assert link.is_symlink()
    assert config.read_bytes() == KEY


def test_a_byte_order_mark_is_kept(config: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    config.write_bytes(codecs.BOM_UTF8 + SEED)
    assert Result(capfdbinary, "c.yaml").out == codecs.BOM_UTF8 + KEY


def test_check(config: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    result = Result(capfdbinary, "c.yaml", "--check")
    assert (result.code, result.out) == (1, b"c.yaml: would change\n")
    result = Result(capfdbinary, "c.yaml", "--check", "--to", "seed")
    assert (result.code, result.out) == (0, b"c.yaml: nothing to change\n")
    assert config.read_bytes() == SEED


def test_a_file_that_another_user_changes_is_not_written(config: Path) -> None:
    file = open_for_edit("c.yaml")
    assert isinstance(file, EditedFile)
    config.write_bytes(KEY)
    with pytest.raises(CommandFailedError, match="changed during the edit; nothing was written"):
        write_edited(file, "mine")
    assert config.read_bytes() == KEY


def test_standard_input(
    monkeypatch: pytest.MonkeyPatch, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(SEED)))
    assert Result(capfdbinary, "-").out == KEY


def test_unmigrated_parts_are_reported_on_stderr(
    config: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    config.write_bytes(b"include: a.yaml\n")
    result = Result(capfdbinary, "c.yaml", "--write")
    assert (result.code, result.out) == (0, b"c.yaml: nothing to change\n")
    assert result.err == (
        "c.yaml:1:10: info[migrate]: the included file is not rewritten; migrate it too\n"
        "  1 | include: a.yaml\n"
        "    |          ^^^^^^\n\n"
    )


@pytest.mark.parametrize(
    ("data", "start"),
    [
        (b"a: [", "c.yaml:1:4: error[OBK003]: the `[` opened here"),
        (b"\xff", "c.yaml:1:1: error[OBK002]: byte 0xff is not UTF-8"),
        (b"a: b\n", "c.yaml:1:1: error[OBK114]: the file contains no config sections"),
    ],
)
def test_a_file_that_is_no_config_is_ignored(
    config: Path, capfdbinary: pytest.CaptureFixture[bytes], data: bytes, start: str
) -> None:
    config.write_bytes(data)
    result = Result(capfdbinary, "c.yaml", "--write")
    assert (result.code, result.out) == (1, b"")
    assert result.err.startswith(start)
    assert config.read_bytes() == data


@pytest.mark.parametrize(
    ("arguments", "code", "error"),
    [
        (("c.yaml", "--to", "old"), 2, "error: `--to old`: expected `key` or `seed`\n"),
        (
            ("-", "--write"),
            2,
            "error: `--write` cannot be combined with a config from standard input\n",
        ),
        (("c.yaml", "--write", "--check"), 2, "error: `--write` cannot be combined with --check\n"),
        (
            ("d.yaml",),
            1,
            "error: `d.yaml` cannot be read: file not found\n  help: available: `c.yaml`\n",
        ),
    ],
)
def test_misuse(
    config: Path,
    capfdbinary: pytest.CaptureFixture[bytes],
    arguments: tuple[str, ...],
    code: int,
    error: str,
) -> None:
    result = Result(capfdbinary, *arguments)
    assert (result.code, result.out, result.err) == (code, b"", error)
