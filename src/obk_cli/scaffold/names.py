"""Names of packages and nodes that ROS, Python and colcon all take.

In: the name that the user typed and what is known of names in use. Out: why it cannot be used and
what would be right, or None. Never looks at the disk.
"""

import keyword
import re
from collections.abc import Callable
from dataclasses import dataclass

from obelisk_spec.names import node_name_fault, package_name_fault

__all__ = ["LONGEST_NAME", "Problem", "check_name", "suggest_name"]

LONGEST_NAME = 40
"""Our own limit [characters]: the name is a folder, a module, an executable and part of a class."""

_OTHER_USE = frozenset("build conftest install log resource setup src test".split())
"""Names that workspaces and packages have for folders and files of another kind."""

_SNAKE_CASE = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One thing that is wrong with what the user asked for, and what would be right."""

    sentence: str
    help: str | None = None


def check_name(name: str, *, kind: str, owner_of: Callable[[str], str | None]) -> Problem | None:
    """Why `name` can be no package or node, None if it can.

    `kind` makes suggestions ("class" -> "class_controller"); `owner_of` tells who has a name
    already, in words that follow "is" ("a module of Python's standard library").

    Source: REP 144 (package names); PEP 8 (module names).
    """
    suggestion = suggest_name(name, kind=kind)
    if "/" in name or "\\" in name or ".." in name:
        sentence = f"the name `{name}` is a path; a bare name was expected"
        return Problem(sentence=sentence, help=f"{_try(suggestion)}; --dest DIR chooses the folder")
    reason = _shape_fault(name) or _use_fault(name, owner_of)
    if reason is None:
        return None
    return Problem(sentence=f"the name `{name}` {reason}", help=_try(suggestion))


def suggest_name(name: str, *, kind: str) -> str:
    """The nearest name of the right shape: `FooBar` and `foo-bar` give `foo_bar`."""
    last = re.split(r"[/\\]", name.rstrip("/\\"))[-1]
    humps = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", last)
    words = re.findall(r"[a-z0-9]+", humps.lower())
    snake = "_".join(words).lstrip("0123456789_")
    if snake == name or len(snake) < 2 or keyword.iskeyword(snake) or snake in _OTHER_USE:
        snake = f"{snake}_{kind}" if snake else f"my_{kind}"
    return snake[:LONGEST_NAME].rstrip("_")


def _shape_fault(name: str) -> str | None:
    if not name:
        return "is empty"
    if len(name) > LONGEST_NAME:
        return f"has {len(name)} characters; at most {LONGEST_NAME} were expected"
    if not _SNAKE_CASE.fullmatch(name):
        return (
            "is not lower snake case; small letters, digits and single `_` were expected, "
            "a letter first"
        )
    fault = package_name_fault(name) or node_name_fault(name)
    return f"is refused by ROS: {fault}" if fault else None


def _use_fault(name: str, owner_of: Callable[[str], str | None]) -> str | None:
    if keyword.iskeyword(name):
        return "is a keyword of Python"
    if name in _OTHER_USE:
        return "stands for something else in workspaces and packages"
    owner = owner_of(name)
    return f"is taken: it is {owner}" if owner else None


def _try(suggestion: str) -> str:
    return f"try `{suggestion}`"
