"""What ROS takes as the name of a topic, a node, a namespace, a package.

Each function takes a name and gives the reason why it is none, or None where it is fine.

Source: ROS 2 design, "Topic and Service name mapping"; rmw/validate_*.h; REP 144.
"""

import re

__all__ = ["namespace_fault", "node_name_fault", "package_name_fault", "topic_name_fault"]

_LONGEST_NODE_NAME = 255


def topic_name_fault(name: str) -> str | None:
    """Why `name` is no topic name, relative, absolute or private (`~/x`); None if it is one."""
    if not name:
        return "it is empty"
    if name != "~" and name.startswith("~") and not name.startswith("~/"):
        return "`~` must be followed by `/`"
    body = name.removeprefix("~")
    if "~" in body:
        return "`~` may stand only at the start"
    return _path_fault(body)


def namespace_fault(name: str) -> str | None:
    """Why `name` is no namespace, with or without its leading `/`; None if it is one."""
    if not name:
        return "it is empty"
    return None if name == "/" else _path_fault(name)


def node_name_fault(name: str) -> str | None:
    """Why `name` is no node name; None if it is one."""
    if not name:
        return "it is empty"
    if len(name) > _LONGEST_NODE_NAME:
        return f"it is longer than {_LONGEST_NODE_NAME} characters"
    return _token_fault(name)


def package_name_fault(name: str) -> str | None:
    """Why `name` is no ROS package name; None if it is one."""
    if re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]+", name):
        return None
    if len(name) < 2:
        return "it needs at least two characters"
    if not name[0].isascii() or not name[0].isalpha():
        return "it must start with a letter"
    return "it may hold only letters, digits, `_` and `-`"


def _path_fault(path: str) -> str | None:
    if path.endswith("/"):
        return "it ends with `/`"
    if "//" in path:
        return "it holds `//`"
    tokens = path.removeprefix("/").split("/")
    return next((fault for fault in map(_token_fault, tokens) if fault), None)


def _token_fault(token: str) -> str | None:
    wrong = re.search(r"[^A-Za-z0-9_]", token)
    if wrong:
        return f"{wrong[0]!r} is not a letter, digit or `_`"
    return f"`{token}` starts with a digit" if token[:1].isdigit() else None
