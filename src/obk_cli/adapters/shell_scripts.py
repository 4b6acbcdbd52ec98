"""Shell scripts that do nothing but run a Python module: read as text, never run."""

import re
from pathlib import Path

__all__ = ["module_run_by"]

_RUNS_MODULE = re.compile(r"exec \S*python[\d.]*\"?(?: -[A-Za-z]+)* -m ([\w.]+) \"\$@\"")
_ASSIGNS = re.compile(r"[a-z_]+=")
_LONGEST_BYTES = 4096


def module_run_by(program: Path) -> str | None:
    """The module, None for any other program; one that also prepares the environment is another."""
    try:
        with program.open("rb") as file:
            text = file.read(_LONGEST_BYTES).decode("utf-8", errors="replace")
    except OSError:
        return None
    if not text.startswith(("#!/bin/sh", "#!/bin/bash", "#!/usr/bin/env bash")):
        return None
    lines = [line.strip() for line in text.splitlines()]
    done = [line for line in lines if line and not line.startswith("#")]
    runs = _RUNS_MODULE.fullmatch(done[-1]) if done else None
    return runs[1] if runs and all(_ASSIGNS.match(line) for line in done[:-1]) else None
