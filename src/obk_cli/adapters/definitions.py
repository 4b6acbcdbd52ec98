"""Message definitions as they were compiled: the `.msg` files in the prefixes of this process."""

import os
from pathlib import Path

from obk_cli.workspace.overlay import underlays_of

__all__ = ["installed_definition"]


def installed_definition(package: str, name: str) -> str | None:
    """The text that defines a message, of the first prefix that has it; None where none has."""
    for prefix in underlays_of(os.environ, ()):
        path = Path(prefix, "share", package, "msg", f"{name}.msg")
        if path.is_file():
            return path.read_text(encoding="utf-8", errors="replace")
    return None
