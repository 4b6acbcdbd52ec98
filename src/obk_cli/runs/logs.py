"""Log files of runs: find one by name, read its lines, follow new ones."""

import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Final

from obelisk_recordings.find import name_and_place
from obelisk_spec.suggestions import did_you_mean, list_names, with_number
from obk_cli.errors import CommandFailedError
from obk_cli.runs.folder import config_of, read_run, run_folders
from obk_cli.runs.registry import select_nodes

__all__ = ["LAUNCH_LOG", "find_log", "follow_lines", "last_lines", "read_lines"]

LAUNCH_LOG: Final = "launch.log"
POLL_S: Final = 0.1
_BLOCK: Final = 1 << 15
"""Block size for reading the last lines [bytes]."""
_MOST: Final = 1 << 20
"""Maximum total size of the last lines [bytes]."""


def find_log(parent: Path, run: str | None, node: str | None) -> Path:
    """The path of a log, which may not exist yet.

    Args:
        parent: the folder of all runs.
        run: name of a config (`NAME~1` for the run before its latest one) or run folder; None: the
            most recent run. If `node` is None, an unknown name is taken for a node of the most
            recent run.
        node: full or short name; None: the output of the launcher.

    Raises:
        CommandFailedError: no such run or node exists, or several nodes match.
    """
    folders = run_folders(parent)
    if not folders:
        raise CommandFailedError(f"no runs in {parent}", help="start a stack with `obk launch`")
    named = None if run is None else _folder(folders, run)
    if run is not None and named is None:
        if node is None and select_nodes(run, _nodes(folders[0])):
            return _node_log(folders[0], run)
        names = dict.fromkeys(config_of(folder) for folder in folders)
        of_newest = () if node else tuple(map(_short, _nodes(folders[0])))
        what = "run" if node else "run, and no node of the latest run,"
        raise CommandFailedError(
            f"no {what} has the name `{run}`", help=did_you_mean(run, (*names, *of_newest))
        )
    folder = named or folders[0]
    return folder / LAUNCH_LOG if node is None else _node_log(folder, node)


def _folder(folders: Sequence[Path], name: str) -> Path | None:
    """The most recent run of a config, the one before for `NAME~1`, or the folder of this name."""
    name, place = name_and_place(name)
    config = name.replace("/", "_")
    fitting = [folder for folder in folders if name == folder.name or config == config_of(folder)]
    if fitting and place >= len(fitting):
        raise CommandFailedError(f"`{name}` has only {with_number(len(fitting), 'run')}")
    return fitting[place] if fitting else None


def _nodes(folder: Path) -> tuple[str, ...]:
    """Full names of the nodes that have a log, or will have one."""
    run = read_run(folder)
    logs = (path.stem for path in sorted(folder.glob("*.log")) if path.name != LAUNCH_LOG)
    written = (f"/{stem.replace('.', '/')}" for stem in logs)
    return tuple(dict.fromkeys((*(run.all_nodes if run else ()), *written)))


def _node_log(folder: Path, name: str) -> Path:
    known = _nodes(folder)
    matching = select_nodes(name, known)
    if not matching:
        raise CommandFailedError(
            f"the run {folder.name} has no node `{name}`",
            help=did_you_mean(name, map(_short, known)),
        )
    if len(matching) > 1:
        raise CommandFailedError(
            f"`{name}` is ambiguous", help=f"choose one of {list_names(map(_short, matching))}"
        )
    return folder / f"{matching[0].strip('/').replace('/', '.')}.log"


def _short(node: str) -> str:
    return node.strip("/").removeprefix("obelisk_")


def read_lines(path: Path) -> Iterator[str]:
    """The lines of a file, without line ends; empty if the file does not exist.

    Raises:
        OSError: the file exists but cannot be read.
    """
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            yield from (line.rstrip("\n") for line in file)
    except FileNotFoundError:
        return


def last_lines(path: Path, count: int) -> tuple[str, ...]:
    """The last lines of a file; fewer if they exceed 1 MiB.

    Raises:
        OSError: the file exists but cannot be read.
    """
    try:
        with path.open("rb") as file:
            start = file.seek(0, os.SEEK_END)
            data = b""
            # One more line end than lines, because the first line may be incomplete.
            while start > 0 and data.count(b"\n") <= count and len(data) < _MOST:
                size = min(_BLOCK, start)
                start -= size
                file.seek(start)
                data = file.read(size) + data
    except FileNotFoundError:
        return ()
    lines = data.decode(errors="replace").removesuffix("\n").split("\n") if data else []
    whole = lines[1:] if start else lines
    return tuple(whole[max(0, len(whole) - count) :])


def follow_lines(path: Path) -> Iterator[str | None]:
    """The lines of a file, then new ones, without end; None each time that it waits.

    It waits for a file that does not exist yet, and continues with a file that replaces it.

    Raises:
        OSError: the file exists but cannot be read.
    """
    while True:
        try:
            with path.open("rb") as file:
                yield from _of_one_file(path, file)
        except FileNotFoundError:
            yield None
            time.sleep(POLL_S)


def _of_one_file(path: Path, file: IO[bytes]) -> Iterator[str | None]:
    """Lines until another file gets the name, or this one is truncated."""
    begun = b""
    while True:
        # Checked before reading, so that lines written before the replacement are still read.
        is_current = _is_current(path, file)
        while piece := file.readline():
            begun += piece
            if begun.endswith(b"\n"):
                yield begun[:-1].decode(errors="replace")
                begun = b""
        if not is_current:
            if begun:
                yield begun.decode(errors="replace")
            return
        yield None
        time.sleep(POLL_S)


def _is_current(path: Path, file: IO[bytes]) -> bool:
    opened = os.fstat(file.fileno())
    try:
        named = path.stat()
    except FileNotFoundError:
        return False
    is_same = (named.st_dev, named.st_ino) == (opened.st_dev, opened.st_ino)
    return is_same and named.st_size >= os.lseek(file.fileno(), 0, os.SEEK_CUR)
