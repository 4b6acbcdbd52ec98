"""Files that are read, and those that are none."""

import os
import sys
from pathlib import Path

import pytest

from obk_cli.adapters.files import STANDARD_INPUT, read_bytes, unwritable
from obk_cli.diagnostics.source import LONGEST_FILE_BYTES


def test_a_named_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    for name in ("pipe", "link"):
        assert read_bytes(str(tmp_path / name)) == "it is a named pipe"


def test_the_pipe_of_a_shell_is_read() -> None:
    there, here = os.pipe()
    os.write(here, b"config: x")
    os.close(here)
    try:
        assert read_bytes(f"/dev/fd/{there}") == b"config: x"
    finally:
        os.close(there)


def test_a_standard_input_that_was_closed_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    assert read_bytes(STANDARD_INPUT) == "it is closed"


def test_what_never_ends_is_read_in_part() -> None:
    read = read_bytes("/dev/zero")
    assert isinstance(read, bytes)
    assert len(read) == LONGEST_FILE_BYTES + 1


def test_a_file_that_may_not_be_written_is_not_told_as_one_that_may_not_be_read(
    tmp_path: Path,
) -> None:
    error = unwritable(tmp_path / "x", PermissionError(13, "Permission denied"))
    assert error.message == f"`{tmp_path}/x` cannot be written: it may not be written"
    gone = unwritable(tmp_path / "x", FileNotFoundError(2, "No such file or directory"))
    assert gone.message.endswith("cannot be written: there is no such file")


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("loop", "too many levels of symbolic links"),
        ("gone", "there is no such file"),
        (".", "it is a folder"),
        ("\0", "embedded null"),
    ],
)
def test_what_is_no_file_says_so(tmp_path: Path, name: str, reason: str) -> None:
    (tmp_path / "loop").symlink_to("loop")
    told = read_bytes(f"{tmp_path}/{name}")
    assert isinstance(told, str)
    assert told.startswith(reason)
