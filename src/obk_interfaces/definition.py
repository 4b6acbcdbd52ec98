"""Check message definitions before the generators run.

Every problem in a `.msg`, `.srv` or `.action` file is reported with its location; malformed text
never raises an exception. The generators check default values and constants.
"""

import difflib
import keyword
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from obk_interfaces.errors import DefinitionProblem
from obk_interfaces.package import Interface, InterfacePackage
from obk_interfaces.prefix import Prefixes

__all__ = ["check_definition", "check_package"]

# Source: ISO/IEC 9899:2011, 6.4.1 (only the lower-case keywords)
_C_KEYWORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if "
    "inline int long register restrict return short signed sizeof static struct switch typedef "
    "union unsigned void volatile while".split()
)

# Source: ISO/IEC 14882:2017, 5.11, with the alternative tokens of table 6
_CPP_KEYWORDS = frozenset(
    "alignas alignof and and_eq asm auto bitand bitor bool break case catch char char16_t char32_t "
    "class compl const const_cast constexpr continue decltype default delete do double "
    "dynamic_cast else enum explicit export extern false float for friend goto if inline int long "
    "mutable namespace new noexcept not not_eq nullptr operator or or_eq private protected public "
    "register reinterpret_cast return short signed sizeof static static_assert static_cast struct "
    "switch template this thread_local throw true try typedef typeid typename union unsigned using "
    "virtual void volatile wchar_t while xor xor_eq".split()
)


def _series(words: Sequence[str]) -> str:
    """`C, C++ and Python`."""
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def _languages_reserving(word: str) -> tuple[str, ...]:
    """Return the languages in which the word is a keyword."""
    languages = (("C", _C_KEYWORDS), ("C++", _CPP_KEYWORDS), ("Python", frozenset(keyword.kwlist)))
    return tuple(language for language, words in languages if word in words)


# Source: design.ros2.org/articles/legacy_interface_definition.html
_PRIMITIVES = frozenset(
    "bool byte char float32 float64 int8 uint8 int16 uint16 int32 uint32 int64 uint64 string "
    "wstring".split()
)
_BOUNDED = frozenset({"string", "wstring"})
_FIELD_NAME = re.compile(r"(?!.*__)(?!.*_$)[a-z][a-z0-9_]*")
_CONSTANT_NAME = re.compile(r"[A-Z](_?[A-Z0-9])*")
_MESSAGE_NAME = re.compile(r"[A-Z][A-Za-z0-9]*")
_TYPE = re.compile(r"(?P<base>[A-Za-z][\w/]*)(?P<bound><=\d+)?(?P<array>\[(<=)?\d*\])?")
_LINE = re.compile(r"\s*(?P<type>\S+)(\s+(?P<name>[^\s=]+)\s*(?P<equals>=)?)?")
_SECTIONS = {"msg": 1, "srv": 2, "action": 3}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Line:
    path: Path
    number: int
    text: str

    def problem(self, start: int, sentence: str, help: str = "") -> DefinitionProblem:
        column = start + 1
        return DefinitionProblem(
            path=self.path, line=self.number, column=column, sentence=sentence, help=help
        )


def check_package(
    package: InterfacePackage, others: Mapping[str, InterfacePackage], prefixes: Prefixes
) -> tuple[DefinitionProblem, ...]:
    """Check every definition of a package; `others` are the packages built together with it."""
    messages = known_messages(package, others, prefixes)
    problems: list[DefinitionProblem] = []
    for interface in package.interfaces:
        path = package.root / interface.file
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            line = path.read_bytes()[: error.start].count(b"\n") + 1
            problems.append(
                DefinitionProblem(path=path, line=line, column=1, sentence="not UTF-8 text")
            )
            continue
        problems += check_definition(path, interface, text, package=package, messages=messages)
    return tuple(problems)


def known_messages(
    package: InterfacePackage, others: Mapping[str, InterfacePackage], prefixes: Prefixes
) -> frozenset[str]:
    """Return every `package/Message` that this package may refer to."""
    known = {f"{package.name}/{i.name}" for i in package.interfaces if i.kind == "msg"}
    for name in package.depends:
        if other := others.get(name):
            known |= {f"{name}/{i.name}" for i in other.interfaces if i.kind == "msg"}
        elif share := prefixes.share_of(name):
            known |= {f"{name}/{file.stem}" for file in (share / "msg").glob("*.idl")}
    return frozenset(known)


def check_definition(
    path: Path,
    interface: Interface,
    text: str,
    *,
    package: InterfacePackage,
    messages: frozenset[str],
) -> tuple[DefinitionProblem, ...]:
    """Return the problems in a definition, in the order of its lines."""
    problems: list[DefinitionProblem] = []
    if not _MESSAGE_NAME.fullmatch(interface.name):
        sentence = f"`{interface.name}` cannot be the name of a message"
        help = "use CamelCase for the name, for example JointState.msg"
        problems.append(
            DefinitionProblem(path=path, line=1, column=1, sentence=sentence, help=help)
        )
    sections = _sections(path, text)
    expected = _SECTIONS[interface.kind]
    if len(sections) != expected:
        sentence = (
            f"the number of `---` lines is {len(sections) - 1}, expected {expected - 1} "
            f"in a .{interface.kind} file"
        )
        problems.append(DefinitionProblem(path=path, line=1, column=1, sentence=sentence))
    for lines in sections:
        problems += _check_section(lines, package, messages)
    return tuple(problems)


def _sections(path: Path, text: str) -> list[list[_Line]]:
    """Split at `---` lines; drop comments and empty lines."""
    sections: list[list[_Line]] = [[]]
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.partition("#")[0].rstrip()
        if line == "---":
            sections.append([])
        elif line.strip():
            sections[-1].append(_Line(path=path, number=number, text=line))
    return sections


def _check_section(
    lines: Sequence[_Line], package: InterfacePackage, messages: frozenset[str]
) -> Iterator[DefinitionProblem]:
    first_line_of: dict[str, int] = {}
    for line in lines:
        match = _LINE.match(line.text)
        if match is None or match["name"] is None:
            token = line.text.strip()
            start = line.text.find(token)
            sentence = f"`{token}` is not followed by a name"
            yield line.problem(start, sentence, "write: <type> <name>")
            continue
        name, start = match["name"], match.start("name")
        check = _check_constant if match["equals"] else _check_field
        yield from _check_type(line, match, package, messages)
        yield from check(line, name, start)
        if name in first_line_of:
            yield line.problem(start, f"`{name}` is already defined on line {first_line_of[name]}")
        first_line_of.setdefault(name, line.number)


def _check_field(line: _Line, name: str, start: int) -> Iterator[DefinitionProblem]:
    if languages := _languages_reserving(name):
        yield line.problem(
            start,
            f"`{name}` is a keyword in {_series(languages)}: the generated code would not compile",
            f"choose another name, such as `{name}_value`",
        )
    elif not _FIELD_NAME.fullmatch(name):
        yield line.problem(
            start,
            f"`{name}` cannot be the name of a field",
            "use lowercase letters, digits and single underscores, starting with a letter",
        )


def _check_constant(line: _Line, name: str, start: int) -> Iterator[DefinitionProblem]:
    if not _CONSTANT_NAME.fullmatch(name):
        yield line.problem(
            start,
            f"`{name}` cannot be the name of a constant",
            "use uppercase letters, digits and single underscores, for example MAX_SPEED",
        )


def _check_type(
    line: _Line, field: re.Match[str], package: InterfacePackage, messages: frozenset[str]
) -> Iterator[DefinitionProblem]:
    text, start = field["type"], field.start("type")
    match = _TYPE.fullmatch(text)
    if match is None or (match["bound"] and match["base"] not in _BOUNDED):
        help = "examples: float64, float64[], float64[9], string<=10, geometry_msgs/Vector3[<=4]"
        yield line.problem(start, f"`{text}` is not a type", help)
        return
    base = match["base"]
    if base in _PRIMITIVES:
        return
    full = base.replace("/msg/", "/") if "/" in base else f"{package.name}/{base}"
    if full not in messages:
        sentence = f"the type `{base}` is not known"
        yield line.problem(start, sentence, _help_for_type(base, package, messages))


def _help_for_type(base: str, package: InterfacePackage, messages: frozenset[str]) -> str:
    owner, slash, _ = base.partition("/")
    if slash and owner != package.name and owner not in package.depends:
        return (
            f"neither package.xml nor CMakeLists.txt declares a dependency on `{owner}`: "
            f"add `<depend>{owner}</depend>` to package.xml"
        )
    names = [*_PRIMITIVES, *messages, *(m.partition("/")[2] for m in messages)]
    near = difflib.get_close_matches(base.replace("/msg/", "/"), sorted(set(names)), n=3)
    spelled = dict.fromkeys(f"`{_spelled_out(name, package, messages)}`" for name in near)
    *others, last = spelled or ("",)
    listed = f"{', '.join(others)} or {last}" if others else last
    return f"did you mean {listed}?" if listed else ""


def _spelled_out(name: str, package: InterfacePackage, messages: frozenset[str]) -> str:
    """Return how to write the type in this package's definitions."""
    if "/" in name or name in _PRIMITIVES or f"{package.name}/{name}" in messages:
        return name
    return next(message for message in sorted(messages) if message.endswith(f"/{name}"))
