"""Find the programs of a Python package: entry points, and modules run by shell scripts."""

import ast
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from obk_cli.optional_deps import distribution_version

__all__ = ["EntryPoint", "installed_console_scripts", "module_run_by", "source_console_scripts"]

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
        *_setup_py_lines(folder / "setup.py"),
        *_setup_cfg_lines(folder / "setup.cfg"),
        *_pyproject_lines(folder / "pyproject.toml"),
    )
    return dict(_entries(lines, folder))


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


def _setup_py_lines(path: Path) -> Iterator[str]:
    """The strings of `console_scripts` in `setup(entry_points={...})`."""
    if not path.is_file():  # reading a pipe or a device might never return
        return
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and key.value == "console_scripts":
                    yield from _texts(value)


def _texts(node: ast.AST) -> Iterator[str]:
    for inner in ast.walk(node):
        if isinstance(inner, ast.Constant) and isinstance(inner.value, str):
            yield inner.value


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
