"""Following a log while it is written, replaced or truncated."""

from pathlib import Path

import pytest

from obk_cli.runs import logs
from obk_cli.runs.logs import follow_lines, last_lines, read_lines


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logs, "POLL_S", 0.0)


def append(path: Path, text: bytes) -> None:
    with path.open("ab") as file:
        file.write(text)


def test_a_file_is_read_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "log"
    assert list(read_lines(path)) == []
    path.write_text("one\n\ntwo")
    assert list(read_lines(path)) == ["one", "", "two"]


def test_only_complete_lines_are_returned(tmp_path: Path) -> None:
    path = tmp_path / "log"
    lines = follow_lines(path)
    assert next(lines) is None  # it does not exist yet
    append(path, b"one\ntw")
    assert [next(lines), next(lines)] == ["one", None]
    append(path, "o ä".encode()[:-1])
    assert next(lines) is None
    append(path, "ä".encode()[-1:] + b"\n")
    assert [next(lines), next(lines)] == ["two ä", None]


def test_a_replaced_file_is_followed(tmp_path: Path) -> None:
    path = tmp_path / "log"
    append(path, b"one\n")
    lines = follow_lines(path)
    assert [next(lines), next(lines)] == ["one", None]
    append(path, b"two\nlast")
    path.rename(tmp_path / "log.1")
    append(path, b"three\n")
    assert [next(lines) for _ in range(4)] == ["two", "last", "three", None]


def test_a_file_that_is_cut_short_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "log"
    append(path, b"a long line\n")
    lines = follow_lines(path)
    assert [next(lines), next(lines)] == ["a long line", None]
    path.write_bytes(b"new\n")
    assert [next(lines), next(lines)] == ["new", None]


def test_the_last_lines_of_a_long_file_are_whole(tmp_path: Path) -> None:
    path = tmp_path / "log"
    path.write_text("".join(f"line {number} {'x' * 600}\n" for number in range(50)))
    assert [line[:8].rstrip() for line in last_lines(path, 2)] == ["line 48", "line 49"]
    assert len(last_lines(path, 49)) == 49
    path.write_text("a\nb\nc\n")
    assert last_lines(path, 2) == ("b", "c")
    assert last_lines(path, 9) == ("a", "b", "c")
    assert last_lines(path, 0) == ()
    assert last_lines(tmp_path / "none", 2) == ()


@pytest.mark.parametrize("block", [1, 2, 3, 4, 5, 100])
def test_the_last_lines_are_those_of_the_file_for_any_block_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    monkeypatch.setattr(logs, "_BLOCK", block)
    path = tmp_path / "log"
    for text in ("", "\n", "a", "a\n", "\n\na\n", "ä\nb\r\u2028c\n\nd"):
        path.write_bytes(text.encode())
        lines = text.removesuffix("\n").split("\n") if text else []
        for count in (1, 2, 3, 9):
            assert list(last_lines(path, count)) == lines[-count:]


def test_of_lines_without_end_only_so_much_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logs, "_BLOCK", 10)
    monkeypatch.setattr(logs, "_MOST", 100)
    path = tmp_path / "log"
    path.write_text("first\n" + "x" * 500 + "\nlast\n")
    assert last_lines(path, 3) == ("last",)
