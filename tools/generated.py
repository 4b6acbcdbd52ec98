"""List or rewrite stale generated files; shared by all generators."""

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

__all__ = ["ROOT", "bring_up_to_date"]

ROOT = Path(__file__).resolve().parents[1]


def bring_up_to_date(
    files: Mapping[Path, str], folders: Iterable[Path], arguments: Sequence[str]
) -> int:
    """Write the files, or with `--check` list stale ones; return the exit code of the process.

    `folders` contain generated files only: files in them that are not in `files` are stale, and
    removed.
    """
    stale = [p for p, t in files.items() if not p.exists() or p.read_text(encoding="utf-8") != t]
    stale += [p for folder in folders for p in folder.glob("*") if p not in files]
    if arguments == ["--check"]:
        sys.stdout.writelines(f"stale: {path.relative_to(ROOT)}\n" for path in stale)
        return 1 if stale else 0
    for path in stale:
        if path in files:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(files[path], encoding="utf-8")
        else:
            path.unlink()
    sys.stdout.write(f"{len(files)} files, {len(stale)} rewritten\n")
    return 0
