"""Add a node to the files of a package: setup.py, setup.cfg, pyproject.toml, package.xml.

Pure: returns new text in which everything else is unchanged, or a problem. setup.py is not run.
"""

import ast
import configparser
import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

from obk_cli.scaffold.kinds import Problem

__all__ = [
    "PackageIdentity",
    "PackageTexts",
    "add_console_script",
    "add_dependencies",
    "add_entry_point",
    "read_identity",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scripts:
    """The list under `console_scripts`; positions are indices into the text."""

    values: tuple[str, ...]
    start: int
    """Opening bracket."""
    close: int
    """Closing bracket."""
    last_end: int
    """After the last element; without elements, after the opening bracket."""


def add_entry_point(setup_py: str, script: str) -> str | Problem:
    """Add a console script ("foo = pkg.foo:main") to setup.py."""
    scripts = _find_scripts(setup_py)
    if scripts is None:
        return Problem(
            sentence="setup.py has no plain list of strings under `console_scripts`, so the "
            "entry point cannot be added without changing the rest",
            help=f'make it a list that contains "{script}", or create another package with --dest',
        )
    taken = next((v for v in scripts.values if _executable(v) == _executable(script)), None)
    if taken is None:
        return _insert(setup_py, scripts, script)
    if "".join(taken.split()) == "".join(script.split()):
        return setup_py
    return Problem(
        sentence=f"setup.py already has the executable `{_executable(script)}`: {taken}",
        help="choose another name",
    )


def _executable(script: str) -> str:
    return script.partition("=")[0].strip()


def _insert(text: str, scripts: _Scripts, script: str) -> str:
    newline = "\r\n" if "\r\n" in text else "\n"
    head, quoted = text[: scripts.last_end], f'"{script}"'
    line_start = text.rfind("\n", 0, scripts.close) + 1
    if not scripts.values:
        margin = _indent_at(text, scripts.close)
        filling = f"{newline}{margin}    {quoted},{newline}{margin}"
        return text[: scripts.start + 1] + filling + text[scripts.close :]
    if text[line_start : scripts.close].strip():
        return f"{head}, {quoted}{text[scripts.last_end :]}"
    on_first_line = "\n" not in text[scripts.start : scripts.last_end]
    margin = (
        text[line_start : scripts.close] + "    "
        if on_first_line
        else _indent_at(text, scripts.last_end)
    )
    comma = "" if _has_comma(text[scripts.last_end : scripts.close]) else ","
    between = text[scripts.last_end : line_start]
    return f"{head}{comma}{between}{margin}{quoted},{newline}{text[line_start:]}"


def _find_scripts(setup_py: str) -> _Scripts | None:
    """The only `"console_scripts": [...]` whose elements are all plain strings."""
    try:
        tree = ast.parse(setup_py)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    lists = [
        value
        for node in ast.walk(tree)
        if isinstance(node, ast.Dict)
        for key, value in zip(node.keys, node.values, strict=True)
        if isinstance(key, ast.Constant) and key.value == "console_scripts"
    ]
    if len(lists) != 1 or not isinstance(lists[0], ast.List):
        return None
    elements = lists[0].elts
    values = [e.value for e in elements if isinstance(e, ast.Constant)]
    strings = tuple(value for value in values if isinstance(value, str))
    if len(strings) != len(elements):
        return None
    start = _offset(setup_py, lists[0].lineno, lists[0].col_offset)
    return _Scripts(
        values=strings,
        start=start,
        close=_end_offset(setup_py, lists[0]) - 1,
        last_end=_end_offset(setup_py, elements[-1]) if elements else start + 1,
    )


def _has_comma(text: str) -> bool:
    """Whether code that otherwise contains only comments has a comma."""
    return any("," in line.partition("#")[0] for line in text.splitlines())


def _indent_at(text: str, place: int) -> str:
    """The white space at the start of the line at this position."""
    line = text[text.rfind("\n", 0, place) + 1 :]
    return line[: len(line) - len(line.lstrip(" \t"))]


def _end_offset(text: str, node: ast.expr) -> int:
    assert node.end_lineno is not None
    assert node.end_col_offset is not None
    return _offset(text, node.end_lineno, node.end_col_offset)


def _offset(text: str, line: int, column: int) -> int:
    """Convert an AST position (line from 1, column in UTF-8 bytes) to an index into the text."""
    lines = text.split("\n")
    before = sum(len(other) + 1 for other in lines[: line - 1])
    return before + len(lines[line - 1].encode()[:column].decode())


_SECTION = "options.entry_points"
_CFG_HEADER = re.compile(r"^\[([^\]\r\n]+)\]", re.M)
_CFG_SCRIPTS = re.compile(r"^console_scripts[ \t]*[=:][^\r\n]*", re.M)
_CFG_LINE = re.compile(r"^(?P<indent>[ \t]*)(?P<rest>[^\r\n]*)", re.M)
_TOML_HEADER = re.compile(r"^[ \t]*\[", re.M)
_TOML_SCRIPTS = re.compile(r"^[ \t]*\[[ \t]*project[ \t]*\.[ \t]*scripts[ \t]*\][^\r\n]*", re.M)
_TOML_ENTRY = re.compile(r"^([ \t]*)[^\s#\[][^\r\n]*", re.M)


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageTexts:
    """The files of an existing package that a new node changes; empty if they do not exist."""

    package_xml: str
    setup_py: str = ""
    setup_cfg: str = ""
    pyproject: str = ""


def add_console_script(texts: PackageTexts, script: str) -> dict[str, str] | Problem:
    """Add a console script ("foo = pkg.foo:main"); return the changed file and its new text."""
    in_cfg, in_toml = _cfg_scripts(texts.setup_cfg), _toml_scripts(texts.pyproject)
    if "console_scripts" not in texts.setup_py:
        if in_cfg is not None:
            return _add("setup.cfg", texts.setup_cfg, in_cfg, script)
        if in_toml is not None:
            return _add("pyproject.toml", texts.pyproject, in_toml, script)
    changed = add_entry_point(texts.setup_py, script)
    return changed if isinstance(changed, Problem) else {"setup.py": changed}


def _add(name: str, text: str, scripts: dict[str, str], script: str) -> dict[str, str] | Problem:
    """Edit the text, and verify that it parses to the old scripts and the new one."""
    executable, _, target = (part.strip() for part in script.partition("="))
    taken = scripts.get(executable)
    if taken == target:
        return {name: text}
    if taken is not None:
        return Problem(
            sentence=f"{name} already has the executable `{executable}`: {executable} = {taken}",
            help="choose another name",
        )
    is_cfg = name == "setup.cfg"
    new = _insert_cfg(text, script) if is_cfg else _insert_toml(text, executable, target)
    reads = _cfg_scripts(new) if is_cfg else _toml_scripts(new)
    if reads == scripts | {executable: target}:
        return {name: new}
    line = script if is_cfg else f'{executable} = "{target}"'
    place = "`console_scripts`" if is_cfg else "[project.scripts]"
    return Problem(
        sentence=f"the entry point cannot be added to {name} without changing the rest",
        help=f"add `{line}` under {place} by hand, or create a separate package with --dest",
    )


def _cfg_scripts(text: str) -> dict[str, str] | None:
    """The scripts of setup.cfg; None if it has none."""
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(text)
    except configparser.Error:
        return None
    if not parser.has_section(_SECTION) and not parser.has_section("options"):
        return None
    lines = parser.get(_SECTION, "console_scripts", fallback="").splitlines()
    pairs = (line.partition("=") for line in lines if "=" in line)
    return {name.strip(): target.strip() for name, _, target in pairs}


def _insert_cfg(text: str, script: str) -> str:
    newline = _newline(text)
    section = next((m for m in _CFG_HEADER.finditer(text) if m[1] == _SECTION), None)
    if section is None:
        lines = f"[{_SECTION}]{newline}console_scripts ={newline}    {script}{newline}"
        return f"{_ended(text, newline)}{newline}{lines}"
    following = _CFG_HEADER.search(text, section.end())
    end = following.start() if following else len(text)
    scripts = _CFG_SCRIPTS.search(text, section.end(), end)
    if scripts is None:
        at = section.end()
        return f"{text[:at]}{newline}console_scripts ={newline}    {script}{text[at:]}"
    at, indent = scripts.end(), "    "
    for line in _CFG_LINE.finditer(text, scripts.end(), end):
        is_comment = line["rest"].startswith(("#", ";"))
        if line["rest"] and not line["indent"] and not is_comment:
            break
        if line["rest"] and line["indent"] and not is_comment:
            at, indent = line.end(), line["indent"]
    return f"{text[:at]}{newline}{indent}{script}{text[at:]}"


def _toml_scripts(text: str) -> dict[str, Any] | None:
    """The scripts of pyproject.toml; None if it describes no project, or they are dynamic."""
    try:
        project = tomllib.loads(text).get("project")
    except tomllib.TOMLDecodeError:
        return None
    if not isinstance(project, dict) or "scripts" in project.get("dynamic", ()):
        return None
    scripts = project.get("scripts", {})
    return scripts if isinstance(scripts, dict) else None


def _insert_toml(text: str, executable: str, target: str) -> str:
    newline, entry = _newline(text), f'{executable} = "{target}"'
    header = _TOML_SCRIPTS.search(text)
    if header is None:
        return f"{_ended(text, newline)}{newline}[project.scripts]{newline}{entry}{newline}"
    following = _TOML_HEADER.search(text, header.end())
    end = following.start() if following else len(text)
    entries = list(_TOML_ENTRY.finditer(text, header.end(), end))
    at = entries[-1].end() if entries else header.end()
    indent = entries[-1][1] if entries else ""
    return f"{text[:at]}{newline}{indent}{entry}{text[at:]}"


def _newline(text: str) -> str:
    return "\r\n" if "\r\n" in text else "\n"


def _ended(text: str, newline: str) -> str:
    return text if not text or text.endswith("\n") else text + newline


_DEPENDS = frozenset({"depend", "exec_depend"})
_DEPEND_LINE = re.compile(r"^([ \t]*)<(?:exec_)?depend\b[^>]*>[^<]*</(?:exec_)?depend>", re.M)
_PACKAGE_END = re.compile(r"^([ \t]*)</package>", re.M)


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageIdentity:
    """The name and build type of a package in its package.xml.

    Source: REP 149 (package.xml format 3): without a build type it is `catkin`.
    """

    name: str
    build_type: str


def read_identity(package_xml: str) -> PackageIdentity | None:
    """Name and build type; None if the text is not a package.xml."""
    root = _parse(package_xml)
    name = None if root is None else root.findtext("name")
    if root is None or not name:
        return None
    build_type = root.findtext("export/build_type") or "catkin"
    return PackageIdentity(name=name.strip(), build_type=build_type.strip())


def add_dependencies(package_xml: str, dependencies: Iterable[str]) -> str:
    """Add an `exec_depend` for each missing package, after the last existing dependency."""
    root = _parse(package_xml)
    have = set() if root is None else {(e.text or "").strip() for e in root if e.tag in _DEPENDS}
    missing = sorted(set(dependencies) - have)
    newline = "\r\n" if "\r\n" in package_xml else "\n"
    places = list(_DEPEND_LINE.finditer(package_xml))
    if places:
        at, indent = places[-1].end(), places[-1][1]
        lines = "".join(f"{newline}{indent}{_exec_depend(name)}" for name in missing)
        return package_xml[:at] + lines + package_xml[at:]
    end = _PACKAGE_END.search(package_xml)
    if end is None:
        return package_xml
    lines = "".join(f"{end[1]}  {_exec_depend(name)}{newline}" for name in missing)
    return package_xml[: end.start()] + lines + package_xml[end.start() :]


def _parse(text: str) -> ElementTree.Element | None:
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError):
        return None


def _exec_depend(name: str) -> str:
    return f"<exec_depend>{name}</exec_depend>"
