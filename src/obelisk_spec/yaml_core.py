"""Read YAML with the YAML 1.2 core schema: `on` is a string, `1e-3` a float.

The result consists of plain Python values. Only the safe subset is supported, so no tag can create
an object. `expand_variables` replaces `${NAME}` and `${NAME:-text}` with values of an environment.

Source: YAML 1.2.2, 10.3 Core Schema.
"""

import json
import re
from collections.abc import Callable, Mapping
from typing import Any, Final, NoReturn

import yaml

__all__ = [
    "MOST_VALUES",
    "REFERENCE",
    "Scalar",
    "YamlTextError",
    "core_scalar",
    "expand_variables",
    "load_yaml_core",
    "quoted_scalar",
    "value_of_reference",
]

Scalar = None | bool | int | float | str

_CONSTANTS: Final[dict[str, Scalar]] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF"), float("inf")),
    **dict.fromkeys(("-.inf", "-.Inf", "-.INF"), float("-inf")),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
}
_INT: Final = re.compile(r"[-+]?[0-9]+")
_BASED: Final = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT: Final = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_MAY_BE_NUMBER: Final = frozenset("+-.0123456789")
MOST_VALUES: Final = 150_000
"""Maximum number of values in a document or config; an alias counts as all values of its anchor."""
_LONGEST_INT: Final = 4000
_LONGEST_BASED: Final = 3000
"""Maximum number of digits; Python does not convert longer ones, and no robot needs them."""


def core_scalar(text: str) -> Scalar:
    """Parse a plain (unquoted) scalar by the YAML 1.2 core schema."""
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if text[0] not in _MAY_BE_NUMBER:
        return text
    if _INT.fullmatch(text):
        return int(text) if len(text) < _LONGEST_INT else text
    if _BASED.fullmatch(text):
        return int(text[2:], 8 if text[1] == "o" else 16) if len(text) < _LONGEST_BASED else text
    return float(text) if _FLOAT.fullmatch(text) else text


_UNWRITABLE: Final = re.compile("[\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]")
"""Characters that YAML does not allow in a document, or that JSON does not escape."""


def quoted_scalar(text: str) -> str:
    """The text as a double-quoted scalar, which is JSON as well."""
    quoted = json.dumps(text, ensure_ascii=False)
    return _UNWRITABLE.sub(lambda found: f"\\u{ord(found[0]):04x}", quoted)


class YamlTextError(ValueError):
    """The text is not valid YAML of the safe subset; the message says where and why."""


class _CoreLoader(yaml.SafeLoader):
    """SafeLoader with the plain scalars of YAML 1.2 core."""

    expand: Callable[[str], str]
    """Applied to the text of each scalar before parsing."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._values = 0
        self._weights: dict[int, int] = {}

    yaml_implicit_resolvers = {  # noqa: RUF012  (the attribute's name and type are PyYAML's)
        "<": [("tag:yaml.org,2002:merge", re.compile(r"<<$"))],
        None: [("!plain", re.compile(""))],
    }

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]  # none of its are
        before = self._values
        node = super().compose_node(parent, index)
        if not isinstance(event, yaml.AliasEvent):
            self._values += 1
            self._weights[id(node)] = self._values - before
        elif id(node) in self._weights:
            self._values += self._weights[id(node)]
        else:
            self._reject(f"the alias `*{event.anchor}` is inside its own value", event)
        if self._values > MOST_VALUES:
            self._reject(f"more than {MOST_VALUES:,} values", event)
        return node

    def _reject(self, problem: str, event: Any) -> NoReturn:
        raise yaml.composer.ComposerError(None, None, problem, event.start_mark)


def _plain(loader: _CoreLoader, node: yaml.ScalarNode) -> Scalar:
    return core_scalar(loader.expand(node.value))


def _quoted(loader: _CoreLoader, node: yaml.ScalarNode) -> str:
    return loader.expand(str(loader.construct_scalar(node)))


_CoreLoader.add_constructor("!plain", _plain)
_CoreLoader.add_constructor("tag:yaml.org,2002:str", _quoted)
_CoreLoader.add_constructor("tag:yaml.org,2002:merge", lambda _, node: node.value)


def load_yaml_core(text: str, expand: Callable[[str], str] = str) -> object:
    """Load a single YAML document.

    Args:
        text: the document.
        expand: applied to the text of each scalar before parsing; may raise a ValueError.

    Raises:
        YamlTextError: the text is not valid YAML, it uses a tag that creates objects, or `expand`
            raised an error.
    """
    try:
        loader = _CoreLoader(text)
        loader.expand = expand
        try:
            return loader.get_single_data()
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise YamlTextError(f"{place}{error.problem or error}") from error
    except (yaml.YAMLError, RecursionError, UnicodeError, ValueError) as error:
        raise YamlTextError(" ".join(str(error).split())) from error


REFERENCE: Final = re.compile(
    # A default has a maximum length, so that input with many `${A:-` is not scanned repeatedly.
    r"\$\$\{|\$\{([A-Za-z_][A-Za-z0-9_]*)(?::-([^}]{0,1000}+))?\}|\$\{"
)
"""A reference with its name and default, an escaped `$${`, or a `${` that starts neither."""


def value_of_reference(reference: re.Match[str], environment: Mapping[str, str]) -> str | None:
    """Return the value of a match of `REFERENCE`; None if it has none."""
    name, default = reference.groups()
    if reference[0] == "$${":
        return "${"
    return environment.get(name, default) if name is not None else None


def expand_variables(text: str, environment: Mapping[str, str]) -> str:
    """Replace every reference in text.

    Raises:
        ValueError: a reference has no value.
    """

    def value_of(reference: re.Match[str]) -> str:
        value = value_of_reference(reference, environment)
        if value is not None:
            return value
        if reference[1] is None:
            raise ValueError("`${` does not start a `${NAME}`")
        raise ValueError(f"environment variable `{reference[1]}` is not set")

    return REFERENCE.sub(value_of, text) if "${" in text else text
