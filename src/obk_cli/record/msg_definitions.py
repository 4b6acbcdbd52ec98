"""Message definitions as recordings store them: one text with every type that a type refers to.

Definitions are the `.msg` files in the prefixes of this process.

Source: MCAP, well-known schema encodings, `ros2msg`.
"""

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

from obk_cli.workspace.overlay import underlays_of

__all__ = ["FindDefinition", "installed_definition", "schema_text"]

FindDefinition = Callable[[str, str], str | None]
"""Package and message -> the text of its `.msg` file, None if there is none."""

_BAR = "=" * 80
# Message types begin with a capital letter, primitive types with a small one.
_OWN_TYPE = re.compile(r"\s*(?:(?P<package>[a-z]\w*)/)?(?P<name>[A-Z]\w*)\s*(?:\[[^\]]*\])?\s+\w")


def schema_text(msg_type: str, find: FindDefinition) -> str | None:
    """The definition of `pkg/msg/Name` with every type that it refers to; None if one is missing.

    Args:
        msg_type: full name.
        find: looks up a definition.
    """
    package, _, name = msg_type.split("/")
    texts: dict[str, str] = {}
    waiting = [(package, name)]
    while waiting:
        package, name = waiting.pop(0)
        if f"{package}/{name}" in texts:
            continue
        text = find(package, name)
        if text is None:
            return None
        texts[f"{package}/{name}"] = text.strip("\n")
        waiting.extend(_parts(text, package))
    first, *others = texts.items()
    return "\n".join([first[1], *(f"{_BAR}\nMSG: {name}\n{text}" for name, text in others)]) + "\n"


def _parts(text: str, package: str) -> Iterator[tuple[str, str]]:
    """Package and name of the messages that a definition's fields are of."""
    for line in text.splitlines():
        field = _OWN_TYPE.match(line.partition("#")[0])
        if field is not None:
            yield field["package"] or package, field["name"]


def installed_definition(package: str, name: str) -> str | None:
    """The definition of a message from the first prefix that has it; None if none has."""
    for prefix in underlays_of(os.environ, ()):
        path = Path(prefix, "share", package, "msg", f"{name}.msg")
        if path.is_file():
            return path.read_text(encoding="utf-8", errors="replace")
    return None
