"""Store the results of a sweep, and the inputs that they were computed from.

`sweep.sqlite` has a `rows` table (see `_TABLES`) with a row per finished case. If a sweep was
interrupted, even by SIGKILL, the next one continues from there.
"""

import fcntl
import hashlib
import json
import os
import shutil
import sqlite3
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final, Self, cast

from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.files import unwritable
from obk_testing.sweep.cases import Outcome, Row, SweepCase

__all__ = ["SweepStore", "hashes_of", "installed_sources"]

_FILE: Final = "sweep.sqlite"
_SCRATCH: Final = "scratch"
_TABLES: Final = """
CREATE TABLE IF NOT EXISTS rows (
    key TEXT PRIMARY KEY,  -- of the case
    test TEXT NOT NULL,
    seed INTEGER,
    overrides TEXT NOT NULL,  -- JSON: path of the config -> value
    outcome TEXT NOT NULL,  -- passed, failed, skipped, died
    why TEXT NOT NULL,
    metrics TEXT NOT NULL,  -- JSON: name -> value
    digest TEXT NOT NULL,
    seconds REAL NOT NULL,
    worker TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS inputs (path TEXT PRIMARY KEY, hash TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS notes (note TEXT PRIMARY KEY);
"""
_SHOWN: Final = 3


class SweepStore:
    """The results in a folder; only one sweep at a time can have it open."""

    def __init__(self, folder: Path, *, restart: bool = False) -> None:
        """Open a folder, creating it if necessary.

        Args:
            folder: the folder with the results.
            restart: whether to replace an unreadable database; `clear` removes results.

        Raises:
            CommandFailedError: another sweep has the folder open, or it cannot be written.
        """
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(folder, os.O_RDONLY)
        except OSError as error:
            raise unwritable(folder, error) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(self._lock)
            raise CommandFailedError(
                f"another sweep is running in {folder}",
                help="wait until it finishes, or choose another folder with `--output`",
            ) from error
        self._remove_scratch()  # left by a killed sweep
        self.scratch.mkdir()
        try:
            self._database = _opened(folder / _FILE)
        except sqlite3.Error as error:
            if restart:
                for path in folder.glob(f"{_FILE}*"):
                    path.unlink()
                self._database = _opened(folder / _FILE)
                return
            os.close(self._lock)
            raise CommandFailedError(
                f"{folder / _FILE} cannot be used: {error}",
                help="use `--restart` to create a new one",
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._database.close()
        self._remove_scratch()
        os.close(self._lock)

    @property
    def scratch(self) -> Path:
        """The folder for temporary files of the workers."""
        return self.folder / _SCRATCH

    def rows(self) -> dict[str, Row]:
        """Return all results, by the key of their case."""
        found = self._database.execute(
            "SELECT key, outcome, why, metrics, digest, seconds, worker FROM rows"
        )
        return {
            key: Row(
                key=key,
                outcome=cast(Outcome, outcome),
                why=why,
                metrics=json.loads(metrics),
                digest=digest,
                seconds=seconds,
                worker=worker,
            )
            for key, outcome, why, metrics, digest, seconds, worker in found
        }

    def clear(self) -> None:
        """Remove all results."""
        with self._database:
            self._database.execute("DELETE FROM rows")
            self._database.execute("DELETE FROM inputs")
            self._database.execute("DELETE FROM notes")

    def add(self, case: SweepCase, row: Row) -> None:
        """Store a result."""
        with self._database:
            self._database.execute(
                "INSERT OR REPLACE INTO rows VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    case.key,
                    case.test,
                    case.seed,
                    json.dumps(dict(case.overrides)),
                    row.outcome,
                    row.why,
                    json.dumps(dict(row.metrics)),
                    row.digest,
                    row.seconds,
                    row.worker,
                ),
            )

    def notes(self) -> tuple[str, ...]:
        """Return notes on special properties of the results."""
        return tuple(note for (note,) in self._database.execute("SELECT note FROM notes"))

    def add_note(self, note: str) -> None:
        """Store a note, without duplicates."""
        with self._database:
            self._database.execute("INSERT OR IGNORE INTO notes VALUES (?)", (note,))

    def inputs(self) -> tuple[str, ...]:
        """Return the names of all inputs of the results; those of files are their paths."""
        return tuple(name for (name,) in self._database.execute("SELECT path FROM inputs"))

    def add_inputs(self, hashes: Mapping[str, str]) -> None:
        """Store hashes of files that a case has read, unless they have one.

        Args:
            hashes: name of an input -> hash.
        """
        with self._database:
            self._database.executemany(
                "INSERT OR IGNORE INTO inputs VALUES (?, ?)", list(hashes.items())
            )

    def require_same_inputs(self, hashes: Mapping[str, str]) -> None:
        """Check that existing results were computed from the same files, and store their hashes.

        Args:
            hashes: name of an input -> hash.

        Raises:
            MisuseError: an input has changed since then.
        """
        count: int = self._database.execute("SELECT count(*) FROM rows").fetchone()[0]
        before = dict(self._database.execute("SELECT path, hash FROM inputs"))
        changed = [name for name, value in before.items() if hashes.get(name, value) != value]
        if changed and count:
            more = f" and {len(changed) - _SHOWN} more" if len(changed) > _SHOWN else ""
            raise MisuseError(
                f"{', '.join(changed[:_SHOWN])}{more} changed since {count} cases of "
                f"{self.folder} ran, so they cannot be continued",
                help="use `--restart` to run them again, or `--output FOLDER` to keep them",
            )
        with self._database:
            self._database.executemany(
                "INSERT OR REPLACE INTO inputs VALUES (?, ?)", list(hashes.items())
            )

    def _remove_scratch(self) -> None:
        shutil.rmtree(self.scratch, ignore_errors=True)


def _opened(path: Path) -> sqlite3.Connection:
    database = sqlite3.connect(path)
    try:
        # A row is written before the next one; only a power failure can lose the last rows.
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("PRAGMA synchronous=NORMAL")
        database.executescript(_TABLES)
    except sqlite3.Error:
        database.close()
        raise
    return database


def hashes_of(paths: Iterable[Path], around: Path) -> dict[str, str]:
    """Return the SHA-256 of files, by path, which is relative to `around` if possible."""
    hashes = {}
    for path in sorted(set(paths)):
        if path.is_file():
            name = path.relative_to(around) if path.is_relative_to(around) else path
            hashes[str(name)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return hashes


def installed_sources() -> dict[str, str]:
    """Return one hash over the modules of the engine and the runtime library."""
    source = Path(__file__).parents[2]
    digest = hashlib.sha256()
    for package in ("obelisk_py", "obelisk_spec", "obk_testing"):
        for path in sorted((source / package).rglob("*.py")):
            digest.update(str(path.relative_to(source)).encode())
            digest.update(path.read_bytes())
    return {"obelisk_py": digest.hexdigest()}
