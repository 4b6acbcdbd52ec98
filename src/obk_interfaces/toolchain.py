"""Finds the compilers and the headers of Python and numpy.

The one place that reads the environment (`CC`, `CXX`). Never runs a compiler.
"""

import importlib
import os
import shlex
import shutil
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

from obk_interfaces.errors import BuildToolError

__all__ = ["Toolchain", "find_compilers", "find_python_headers", "find_toolchain"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Toolchain:
    """Commands for C and C++, and the header folders that every unit needs."""

    cc: tuple[str, ...]
    cxx: tuple[str, ...]
    includes: tuple[Path, ...]


def find_toolchain() -> Toolchain:
    """Find what is needed to compile an extension module for this Python.

    Raises:
        BuildToolError: something is missing; the text says what to install.
    """
    cc, cxx = find_compilers()
    return Toolchain(cc=cc, cxx=cxx, includes=(*find_python_headers(), _numpy_include()))


def find_compilers() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the commands for C and for C++.

    Raises:
        BuildToolError: one of them is not installed.
    """
    return (
        _compiler("CC", "C", ("gcc", "cc", "clang")),
        _compiler("CXX", "C++", ("g++", "c++", "clang++")),
    )


def _compiler(variable: str, language: str, usual: tuple[str, ...]) -> tuple[str, ...]:
    chosen = os.environ.get(variable)
    candidates = (tuple(shlex.split(chosen)),) if chosen else tuple((name,) for name in usual)
    for command in candidates:
        if command and shutil.which(command[0]):
            return command
    tried = f"{variable}={chosen}" if chosen else ", ".join(usual)
    raise BuildToolError(
        f"no {language} compiler found ({tried}): install one "
        "(Debian, Ubuntu: apt install g++; Fedora: dnf install gcc-c++)"
    )


def find_python_headers() -> tuple[Path, ...]:
    """Return the folders of `Python.h` and `pyconfig.h`.

    Raises:
        BuildToolError: the headers are not installed.
    """
    paths = sysconfig.get_paths()
    candidates = (paths["include"], paths["platinclude"], sysconfig.get_config_var("INCLUDEPY"))
    found = (Path(c) for c in dict.fromkeys(candidates) if c and Path(c, "Python.h").is_file())
    if includes := tuple(found):
        return includes
    version = f"{sys.version_info[0]}.{sys.version_info[1]}"
    raise BuildToolError(
        f"the headers of Python {version} (Python.h) are not in {paths['include']}: install them "
        f"(Debian, Ubuntu: apt install python{version}-dev; Fedora: dnf install python3-devel)"
    )


def _numpy_include() -> Path:
    try:
        numpy = importlib.import_module("numpy")
    except ImportError as error:
        raise BuildToolError("numpy is not installed: pip install 'numpy>=2'") from error
    return Path(numpy.get_include())
