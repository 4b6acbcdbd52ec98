"""`${NAME}` and `${NAME:-text}` in a text. The environment comes in as a mapping."""

import re
from collections.abc import Mapping
from typing import Final

__all__ = ["REFERENCE", "expand_variables", "value_of_reference"]

REFERENCE: Final = re.compile(
    # A default is bounded, lest every `${A:-` of a text be compared with all that follows it.
    r"\$\$\{|\$\{([A-Za-z_][A-Za-z0-9_]*)(?::-([^}]{0,1000}+))?\}|\$\{"
)
"""A reference with its name and its default, `$${`, or a `${` that begins neither."""


def value_of_reference(reference: re.Match[str], environment: Mapping[str, str]) -> str | None:
    """What stands for a match of `REFERENCE`; None: nothing does."""
    name, default = reference.groups()
    if reference[0] == "$${":
        return "${"
    return environment.get(name, default) if name is not None else None


def expand_variables(text: str, environment: Mapping[str, str]) -> str:
    """The text with every reference replaced.

    Raises:
        ValueError: nothing stands for one of them.
    """

    def value_of(reference: re.Match[str]) -> str:
        value = value_of_reference(reference, environment)
        if value is not None:
            return value
        if reference[1] is None:
            raise ValueError("`${` does not begin a `${NAME}`")
        raise ValueError(f"environment variable `{reference[1]}` is not set")

    return REFERENCE.sub(value_of, text) if "${" in text else text
