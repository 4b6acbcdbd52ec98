"""What follows a message in the name of one of its fields: `.position[0]`."""

import re
from typing import Final

__all__ = ["field_steps"]

_STEP: Final = re.compile(r"\.(?P<name>[A-Za-z]\w*)|\[(?P<index>[0-9]{1,9})\]")


def field_steps(text: str) -> tuple[str | int, ...]:
    """Names and places in arrays, outermost first, of `.position[0]`; empty where it is no such."""
    steps = [*_STEP.finditer(text)]
    if sum(len(step[0]) for step in steps) != len(text):
        return ()
    return tuple(step["name"] or int(step["index"]) for step in steps)
