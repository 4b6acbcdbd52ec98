"""Runs the nodes of a file in this process: `python -m obelisk_py.core.composition SPEC.json`."""

import sys
from pathlib import Path

from obelisk_py.core.composition.host import run_composed
from obelisk_py.core.composition.programs import read_programs

__all__ = ["main"]


def main() -> int:
    """Run until the nodes are asked to end; the exit code."""
    if len(sys.argv) != 2:
        sys.stderr.write("usage: python -m obelisk_py.core.composition SPEC.json\n")
        return 2
    return run_composed(read_programs(Path(sys.argv[1])))


if __name__ == "__main__":
    sys.exit(main())
