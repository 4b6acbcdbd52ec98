"""A console script added to a package where the package keeps its scripts, the rest kept.

In: the texts of setup.py, setup.cfg and pyproject.toml. Out: the new text of one of them, or why it
cannot be done and what the user can do. Never runs them and never touches the disk.
"""

import configparser
import re
import tomllib
from dataclasses import dataclass
from typing import Any

from obk_cli.scaffold.names import Problem
from obk_cli.scaffold.setup_py import add_entry_point

__all__ = ["PackageTexts", "add_console_script"]

_SECTION = "options.entry_points"
_CFG_HEADER = re.compile(r"^\[([^\]\r\n]+)\]", re.M)
_CFG_SCRIPTS = re.compile(r"^console_scripts[ \t]*[=:][^\r\n]*", re.M)
_CFG_LINE = re.compile(r"^(?P<indent>[ \t]*)(?P<rest>[^\r\n]*)", re.M)
_TOML_HEADER = re.compile(r"^[ \t]*\[", re.M)
_TOML_SCRIPTS = re.compile(r"^[ \t]*\[[ \t]*project[ \t]*\.[ \t]*scripts[ \t]*\][^\r\n]*", re.M)
_TOML_ENTRY = re.compile(r"^([ \t]*)[^\s#\[][^\r\n]*", re.M)


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageTexts:
    """The files of an existing package that a new node changes; empty where there is none."""

    package_xml: str
    setup_py: str = ""
    setup_cfg: str = ""
    pyproject: str = ""


def add_console_script(texts: PackageTexts, script: str) -> dict[str, str] | Problem:
    """Add a console script ("foo = pkg.foo:main"): the file that changes, and its new text."""
    in_cfg, in_toml = _cfg_scripts(texts.setup_cfg), _toml_scripts(texts.pyproject)
    if "console_scripts" not in texts.setup_py:
        if in_cfg is not None:
            return _add("setup.cfg", texts.setup_cfg, in_cfg, script)
        if in_toml is not None:
            return _add("pyproject.toml", texts.pyproject, in_toml, script)
    changed = add_entry_point(texts.setup_py, script)
    return changed if isinstance(changed, Problem) else {"setup.py": changed}


def _add(name: str, text: str, scripts: dict[str, str], script: str) -> dict[str, str] | Problem:
    """Edit the text, and believe it only when it reads back as the old scripts and the new one."""
    executable, _, target = (part.strip() for part in script.partition("="))
    taken = scripts.get(executable)
    if taken == target:
        return {name: text}
    if taken is not None:
        return Problem(
            sentence=f"{name} has the executable `{executable}` already: {executable} = {taken}",
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
        sentence=f"the entry point cannot be added to {name} without touching the rest",
        help=f"add `{line}` under {place} by hand, or make a package of its own with --dest",
    )


def _cfg_scripts(text: str) -> dict[str, str] | None:
    """The scripts of setup.cfg; None where they are not kept there."""
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
    """The scripts of pyproject.toml; None where it describes no project, or they are dynamic."""
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
