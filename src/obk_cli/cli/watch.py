"""`obk validate --watch`: check again when a file that the check has read changes."""

import contextlib
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from obk_cli.compiler import Options, Outcome, compile_config
from obk_cli.config.model import Stack
from obk_cli.files import read_bytes
from obk_cli.workspace.environment import MachineEnvironment

__all__ = ["WatchedRun", "pause", "watch"]

_POLL_S = 0.2
Mark = tuple[int, int] | None
"""Modification time [ns] and size of a file, None where there is none."""


@dataclass(slots=True)
class WatchedRun:
    """Compiles configs and notes the state in which it found every file."""

    options: Options
    marks: dict[Path, Mark] = field(default_factory=dict)

    def compile(self, config: str) -> Outcome:
        """Compile one config."""
        options = self.options
        environment = MachineEnvironment(
            (options.working_folder / config).resolve().parent,
            options.working_folder,
            options.variables,
            note=self._note,
        )
        options = replace(options, read=self._read, environment=environment)
        outcome = compile_config(config, options)
        if outcome.config is not None:
            for path in _files_of(outcome.config):
                self._note(path)
        return outcome

    def _read(self, path: str) -> bytes | str:
        self._note(self.options.working_folder / path)
        return read_bytes(path)

    def _note(self, path: Path) -> None:
        """What counts is the state before a file is read: a change meanwhile is one."""
        if path not in self.marks:
            self.marks[path] = _mark(path)


def watch(check: Callable[[], Mapping[Path, Mark]], wait: Callable[[], None]) -> None:
    """Run `check` now and after each change of the files that it names, until interrupted."""
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            marks = check()
            while _marks(marks) == marks:
                wait()
            _settle(marks, wait)


def pause() -> None:
    """Wait until the files are polled again."""
    time.sleep(_POLL_S)


def _settle(paths: Iterable[Path], wait: Callable[[], None]) -> None:
    """Wait until the files stop changing: an editor removes the old file first."""
    before = None
    while before != (now := _marks(paths)):
        before = now
        wait()


def _marks(paths: Iterable[Path]) -> dict[Path, Mark]:
    return {path: _mark(path) for path in paths}


def _mark(path: Path) -> Mark:
    try:
        state = path.stat()
    except (OSError, ValueError):
        return None
    return state.st_mtime_ns, state.st_size


def _files_of(stack: Stack) -> Iterable[Path]:
    """Where files beside the configs were looked for, whether they are there or not."""
    for node in stack.nodes:
        of_sims = (search for sim in node.sims for search in (sim.model, *sim.files))
        for search in (*of_sims, node.params_file, node.urdf_file):
            if search is not None:
                yield from search.tried
