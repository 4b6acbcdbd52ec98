"""Makes the rosidl generators parse each IDL file once instead of six times.

Each generator reads every file with a slow Earley parser; a memo for the length of one build saves
a third of the generation's time. This reaches into foreign modules, so it is kept in one place
and undone at the end.
"""

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["parsing_each_idl_once"]

_NAME = "parse_idl_file"
_USERS = (
    "rosidl_pycommon",
    "rosidl_generator_type_description",
    "rosidl_generator_py.generate_py_impl",
)


@contextmanager
def parsing_each_idl_once() -> Iterator[None]:
    """Within the block, the generators remember what they have parsed."""
    parse = getattr(importlib.import_module("rosidl_parser.parser"), _NAME)
    seen: dict[str, Any] = {}

    def parse_once(locator: Any) -> Any:
        key = str(locator.get_absolute_path())
        if key not in seen:
            seen[key] = parse(locator)
        return seen[key]

    users = [importlib.import_module(name) for name in _USERS]
    for module in users:
        setattr(module, _NAME, parse_once)
    try:
        yield
    finally:
        for module in users:
            setattr(module, _NAME, parse)
