"""Find the programs of a Python package: entry points, and modules run by shell scripts."""

import ast
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from obk_cli.optional_deps import distribution_version

__all__ = [
    "EntryPoint",
    "computes_console_scripts",
    "installed_console_scripts",
    "module_run_by",
    "setup_scripts",
    "source_console_scripts",
]

_ENTRY = re.compile(r"\s*([\w.-]+)\s*=\s*([\w.]+)\s*:\s*([\w.]+)")


@dataclass(frozen=True, slots=True, kw_only=True)
class EntryPoint:
    """A function that a script calls."""

    module: str
    function: str
    package_root: str = "."
    """The folder to import from, relative to the package's folder."""


def source_console_scripts(folder: Path) -> Mapping[str, EntryPoint]:
    """Script name -> function, for a package in source."""
    lines = (
        *(line for line in _setup_py_lines(folder / "setup.py") if line is not None),
        *_setup_cfg_lines(folder / "setup.cfg"),
        *_pyproject_lines(folder / "pyproject.toml"),
    )
    return dict(_entries(lines, folder))


def setup_scripts(folder: Path) -> tuple[str, ...]:
    """The files in `setup(scripts=...)`, relative to the package's folder."""
    texts = _setup_py_texts(folder / "setup.py", _script_files)
    return tuple(text for text in texts if text is not None)


def computes_console_scripts(folder: Path) -> bool:
    """Whether only running a package's setup.py would show all of its scripts."""
    return None in _setup_py_lines(folder / "setup.py")


def installed_console_scripts(package: str) -> Mapping[str, EntryPoint]:
    """Script name -> function, for an installed distribution with this name."""
    if distribution_version(package) is None:
        return {}
    from importlib import metadata  # slow to import, and rarely needed

    try:
        points = metadata.distribution(package).entry_points.select(group="console_scripts")
    except (metadata.PackageNotFoundError, ValueError):
        return {}
    return {point.name: EntryPoint(module=point.module, function=point.attr) for point in points}


def _entries(lines: Iterable[str], folder: Path) -> Iterator[tuple[str, EntryPoint]]:
    for line in lines:
        parts = _ENTRY.match(line)
        if parts:
            name, module, function = parts.groups()
            yield (
                name,
                EntryPoint(module=module, function=function, package_root=_root_of(module, folder)),
            )


def _root_of(module: str, folder: Path) -> str:
    """`src` for a package with that layout, otherwise the package's folder."""
    top = module.partition(".")[0]
    in_src = folder / "src" / top
    return "src" if in_src.exists() or in_src.with_suffix(".py").exists() else "."


def _setup_py_lines(path: Path) -> Iterator[str | None]:
    """The lines of `console_scripts` in `setup(entry_points=...)`; None for each computed one."""
    for text in _setup_py_texts(path, _script_values):
        yield from [None] if text is None else text.splitlines()


def _setup_py_texts(
    path: Path, values: Callable[[ast.AST], Iterator[ast.expr]]
) -> Iterator[str | None]:
    """The texts in expressions of a setup.py; None for each computed one."""
    if not path.is_file():  # reading a pipe or a device might never return
        return
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        constants = _constants(tree)
        for node in ast.walk(tree):
            for value in values(node):
                yield from islice(_texts(value, constants), _MOST_TEXTS)
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return


def _script_values(node: ast.AST) -> Iterator[ast.expr]:
    """The values of `{"console_scripts": ...}` and `dict(console_scripts=...)`.

    Also that of `entry_points=` with a text in the format of an INI file, whose lines have the same
    form.
    """
    if isinstance(node, ast.Dict):
        for key, value in zip(node.keys, node.values, strict=True):
            if isinstance(key, ast.Constant) and key.value == "console_scripts":
                yield value
    elif isinstance(node, ast.keyword):
        is_text = not isinstance(node.value, ast.Dict | ast.Call | ast.Name)
        if node.arg == "console_scripts" or (node.arg == "entry_points" and is_text):
            yield node.value


def _script_files(node: ast.AST) -> Iterator[ast.expr]:
    """The values of `scripts=`."""
    if isinstance(node, ast.keyword) and node.arg == "scripts":
        yield node.value


Constants = Mapping[str, tuple[str | None, ...]]
"""Variable -> its texts; None for a text that is computed."""

_LONGEST_TEXT = 10_000
_MOST_TEXTS = 1_000
"""Limits for variables, because each may contain another one several times."""


def _constants(tree: ast.Module) -> Constants:
    """The variables of a module that are set once."""
    found: dict[str, tuple[str | None, ...]] = {}
    for statement in tree.body:
        match statement:
            case (
                ast.Assign(targets=[ast.Name(id=name)], value=value)
                | ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value)
            ):
                texts = tuple(islice(_texts(value, found), _MOST_TEXTS + 1))
                is_known = name not in found and len(texts) <= _MOST_TEXTS
                found[name] = texts if is_known else (None,)
    return found


def _texts(node: ast.expr, constants: Constants) -> Iterator[str | None]:
    """The texts of a list, or a single text; None for one that is computed."""
    match node:
        case ast.List(elts=elements) | ast.Tuple(elts=elements) | ast.Set(elts=elements):
            for element in elements:
                yield from _texts(element, constants)
        case ast.Starred(value=value):
            yield from _texts(value, constants)
        case ast.Name(id=name):
            yield from constants.get(name, (None,))
        case ast.ListComp(
            elt=element,
            generators=[ast.comprehension(target=ast.Name(id=name), iter=items, ifs=[])],
        ):
            for text in _texts(items, constants):
                yield from _texts(element, {**constants, name: (text,)})
        case ast.BinOp(left=left, op=ast.Add(), right=right) if _text(node, constants) is None:
            yield from _texts(left, constants)
            yield from _texts(right, constants)
        case _:
            text = _text(node, constants)
            yield text
            if text is None:  # a part of it may be complete, such as a branch of a condition
                inner = (n.value for n in ast.walk(node) if isinstance(n, ast.Constant))
                yield from (value for value in inner if isinstance(value, str))


def _text(node: ast.expr, constants: Constants) -> str | None:
    """A text made of constants; None if it is computed."""
    parts: list[str | None]
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.Name(id=name):
            texts = constants.get(name, ())
            return texts[0] if len(texts) == 1 else None
        case ast.JoinedStr(values=values):
            parts = [_text(value, constants) for value in values]
        case ast.FormattedValue(value=value, conversion=-1, format_spec=None):
            return _text(value, constants)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            parts = [_text(left, constants), _text(right, constants)]
        case ast.BinOp(left=ast.Constant(value=str(text)), op=ast.Mod(), right=right):
            given = right.elts if isinstance(right, ast.Tuple) else [right]
            parts = _filled(text.split("%s"), given, constants)
        case ast.Call(
            func=ast.Attribute(value=ast.Constant(value=str(text)), attr="format"), keywords=[]
        ):
            parts = _filled(text.split("{}"), node.args, constants)
        case _:
            return None
    known = [part for part in parts if part is not None]
    text = "".join(known)
    return text if len(known) == len(parts) and len(text) <= _LONGEST_TEXT else None


def _filled(
    pieces: Sequence[str], given: Sequence[ast.expr], constants: Constants
) -> list[str | None]:
    """The pieces of a text with values in between; [None] for another number of values."""
    if len(pieces) != len(given) + 1:
        return [None]
    values = (_text(value, constants) for value in given)
    inside = [part for pair in zip(pieces, values, strict=False) for part in pair]
    return [*inside, pieces[-1]]


def _setup_cfg_lines(path: Path) -> Iterator[str]:
    if not path.is_file():
        return
    import configparser  # rarely needed, like `tomllib`

    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read(path, encoding="utf-8")
    except (configparser.Error, UnicodeDecodeError):
        return
    yield from parser.get("options.entry_points", "console_scripts", fallback="").splitlines()


def _pyproject_lines(path: Path) -> Iterator[str]:
    if not path.is_file():
        return
    import tomllib

    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError):
        return
    project = table.get("project")
    scripts = project.get("scripts") if isinstance(project, dict) else None
    for name, target in (scripts if isinstance(scripts, dict) else {}).items():
        yield f"{name} = {target}"


_RUNS_MODULE = re.compile(r"exec \S*python[\d.]*\"?(?: -[A-Za-z]+)* -m ([\w.]+) \"\$@\"")
_ASSIGNS = re.compile(r"[a-z_]+=")
_LONGEST_BYTES = 4096


def module_run_by(program: Path) -> str | None:
    """The module that a script runs; None for other programs or if it also sets up environments."""
    try:
        with program.open("rb") as file:
            text = file.read(_LONGEST_BYTES).decode("utf-8", errors="replace")
    except OSError:
        return None
    if not text.startswith(("#!/bin/sh", "#!/bin/bash", "#!/usr/bin/env bash")):
        return None
    lines = [line.strip() for line in text.splitlines()]
    done = [line for line in lines if line and not line.startswith("#")]
    runs = _RUNS_MODULE.fullmatch(done[-1]) if done else None
    return runs[1] if runs and all(_ASSIGNS.match(line) for line in done[:-1]) else None
