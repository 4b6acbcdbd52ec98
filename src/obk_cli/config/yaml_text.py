"""A text as PyYAML is to read it, and the characters that YAML does not allow in it."""

import re

import yaml

from obk_cli.diagnostics.diagnostic import Diagnostic, found
from obk_cli.diagnostics.source import SourceFile, Span

__all__ = ["YAML_LOADER", "YamlText", "forbidden_character"]

YAML_LOADER = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader
"""The quicker of PyYAML's two parsers; both are safe."""

_BREAKS_OF_YAML_1_1 = "\x85\u2028\u2029"
_PRIVATE_USE = range(0xE000, 0xF8FF)

_FORBIDDEN = re.compile(
    "[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]"
)


class YamlText:
    """A text as PyYAML is to see it: it takes characters for line breaks that only YAML 1.1 did.

    Others stand in for those, one for one, so that places stay what they are.
    """

    __slots__ = ("_restored", "text")

    def __init__(self, text: str) -> None:
        self.text = text
        self._restored: dict[int, str] = {}
        if any(char in text for char in _BREAKS_OF_YAML_1_1):
            taken = set(text)
            free = (code for code in _PRIVATE_USE if chr(code) not in taken)
            self._restored = dict(zip(free, _BREAKS_OF_YAML_1_1, strict=False))
            self.text = text.translate({ord(char): code for code, char in self._restored.items()})

    def restored(self, value: str) -> str:
        """A value that was read from the text, as it stands in the user's."""
        return value.translate(self._restored) if self._restored else value


def forbidden_character(source: SourceFile) -> Diagnostic | None:
    """The first character that YAML does not take, such as a control character."""
    wrong = _FORBIDDEN.search(source.text)
    if wrong is None:
        return None
    before = SourceFile.of(source.path, source.text[: wrong.start()]).lines
    return found(
        "OBK003",
        f"character U+{ord(wrong[0]):04X} cannot stand in YAML",
        Span.at(source, len(before), len(before[-1]) + 1),
        help='inside double quotes it can be written as an escape such as "\\x07"',
    )
