"""`obk` on a machine that lacks something: a message, and no internal error."""

import errno
import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from obk_cli import errors
from obk_cli.cli.main import main
from obk_cli.errors import pythonpath_shadow, resource_error

VALID_CONFIG = Path(__file__).parents[2] / "cases/accept/OBK004/topic_twice.yaml"
OBK = Path(sys.executable).with_name("obk")


def failing(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    """Make `obk validate` fail with an unexpected error."""

    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr("obk_cli.cli.validate.compile_config", fail)


@pytest.mark.parametrize(
    ("error", "reported"),
    [
        (OSError(errno.ENOSPC, "no", "/a/b"), "`/a/b`: the disk is full"),
        (OSError(errno.ENOSPC, "no"), "the disk is full"),
        (OSError(errno.EMFILE, "no"), "too many open files in this process (see `ulimit -n`)"),
        (MemoryError(), "out of memory (see `ulimit -v`)"),
        (OSError(errno.ENOMEM, "no"), "out of memory (see `ulimit -v`)"),
        (
            RuntimeError("can't start new thread"),
            "cannot start more threads or processes (see `ulimit -u`, `ulimit -v`)",
        ),
        (
            OSError(errno.EAGAIN, "no"),
            "cannot start more threads or processes (see `ulimit -u`, `ulimit -v`)",
        ),
    ],
)
def test_missing_resources_of_the_machine_are_reported_with_a_message(
    error: Exception,
    reported: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    failing(monkeypatch, error)
    with pytest.raises(SystemExit) as ended:
        main(["validate", str(VALID_CONFIG)])
    assert ended.value.code == 1
    assert capsys.readouterr().err == f"error: {reported}\n"


@pytest.mark.parametrize(
    "error",
    [
        OSError(errno.ENOENT, "no", "/a/b"),
        OSError("no number"),
        RuntimeError("boom"),
        BlockingIOError(errno.EAGAIN, "write could not complete without blocking", 3),
    ],
)
def test_other_errors_are_not_missing_resources(error: Exception) -> None:
    assert resource_error(error) is None


def test_a_trace_that_cannot_be_kept_is_reported_of_nevertheless(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "no")

    failing(monkeypatch, ZeroDivisionError("boom"))
    monkeypatch.setattr("tempfile.NamedTemporaryFile", full)
    with pytest.raises(SystemExit) as ended:
        main(["validate", str(VALID_CONFIG)])
    assert ended.value.code == 1
    reported = (
        "this is a bug in obk (ZeroDivisionError: boom); run `obk --debug` to see the traceback"
    )
    assert capsys.readouterr().err == f"error: {reported}\n"


@pytest.mark.parametrize("closed", ["stdin", "stdout", "stderr"])
def test_a_standard_stream_that_is_closed_leads_nowhere(
    closed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("stdin", "stdout", "stderr"):
        monkeypatch.setattr(sys, name, None if name == closed else io.StringIO())
    with pytest.raises(SystemExit) as ended:
        main(["validate", "-" if closed == "stdin" else str(VALID_CONFIG)])
    stream = getattr(sys, closed)
    assert ended.value.code == (1 if closed == "stdin" else 0)
    assert stream.name == os.devnull
    assert os.get_inheritable(stream.fileno())
    stream.close()


def test_a_working_folder_that_was_removed_is_reported(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    command = f"cd '{gone}' && rmdir '{gone}' && exec '{OBK}' validate '{VALID_CONFIG}'"
    ended = subprocess.run(
        ["/bin/sh", "-c", command], capture_output=True, text=True, timeout=60, check=False
    )
    assert ended.returncode == 1
    assert ended.stderr == "error: the working folder no longer exists\n"


def test_an_output_on_a_full_disk_is_reported() -> None:
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            [OBK, "explain"], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60
        )
    assert (ended.returncode, ended.stderr) == (1, "error: the disk is full\n")


@pytest.mark.parametrize(
    ("module", "text", "reported"),
    [
        ("typer", "raise RuntimeError('of another Python')", "RuntimeError: of another Python"),
        ("yaml", "x = 1", "AttributeError: module 'yaml' has no attribute"),
        ("yaml", "x =", "SyntaxError: invalid syntax"),
        ("click", "x = 1", "No module named 'click."),
    ],
)
def test_a_module_that_shadows_a_library_is_named(
    tmp_path: Path, module: str, text: str, reported: str
) -> None:
    (tmp_path / f"{module}.py").write_text(text)
    ended = subprocess.run(
        [OBK, "validate", VALID_CONFIG],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )
    assert ended.returncode == 1
    assert ended.stderr.startswith("error: ")
    assert reported in ended.stderr
    assert f"`{tmp_path}/{module}.py` shadows a library" in ended.stderr
    assert ended.stderr.endswith("\n  help: unset PYTHONPATH\n")


def test_internal_failures_are_reported_as_such_anywhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(errors.__file__).parents[1]))
    with pytest.raises(AttributeError) as error:
        _ = errors.no_such_thing  # type: ignore[attr-defined]
    assert pythonpath_shadow(error.value) is None
