"""The text of a message type as recordings carry it: its definition and those that it refers to.

In: a type's full name and a function that finds definitions. Out: one text for a decoder that has
no ROS. Source: MCAP, well-known schema encodings, `ros2msg`.
"""

import re
from collections.abc import Callable, Iterator

__all__ = ["FindDefinition", "schema_text"]

FindDefinition = Callable[[str, str], str | None]
"""Package and message -> the text of its `.msg` file, None where there is none."""

_BAR = "=" * 80
# A type of one's own begins with a capital letter, those of the language with a small one.
_OWN_TYPE = re.compile(r"\s*(?:(?P<package>[a-z]\w*)/)?(?P<name>[A-Z]\w*)\s*(?:\[[^\]]*\])?\s+\w")


def schema_text(msg_type: str, find: FindDefinition) -> str | None:
    """The definition of `pkg/msg/Name` with all that it needs; None where one of them is missing.

    Args:
        msg_type: full name.
        find: where definitions come from.
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
