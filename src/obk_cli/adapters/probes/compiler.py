"""A line compiled and linked against Python's headers, as a message package is."""

import os
import tempfile
from pathlib import Path
from typing import Final

from obk_cli.adapters.probes.child import try_program
from obk_cli.doctor.compiler import CompilerFacts
from obk_interfaces.errors import BuildToolError
from obk_interfaces.toolchain import Toolchain, find_toolchain

__all__ = ["probe_compiler"]

COMPILE_S: Final = 20.0
SOURCES: Final = {
    "c": "#include <Python.h>\nint of_c(void) { return PY_MAJOR_VERSION; }\n",
    "cpp": '#include <string>\nextern "C" int of_c();\nint both() { return of_c(); }\n',
}


def probe_compiler() -> CompilerFacts:
    """Compile C and C++, and link both into a library."""
    try:
        tools = find_toolchain()
    except BuildToolError as missing:
        return CompilerFacts(commands=(), fault=str(missing), cure=_cure())
    commands = (" ".join(tools.cc), " ".join(tools.cxx))
    with tempfile.TemporaryDirectory(prefix="obk-doctor-") as folder:
        return CompilerFacts(commands=commands, fault=_fault(tools, Path(folder)), cure=_cure())


def _cure() -> str:
    """What to try first where the user has chosen the compilers, else nothing in particular."""
    chosen = [name for name in ("CC", "CXX") if os.environ.get(name)]
    return f"unset {' '.join(chosen)}" if chosen else ""


def _fault(tools: Toolchain, folder: Path) -> str:
    """What a compiler or the linker complained of, empty for nothing."""
    flags = ("-fPIC", *(f"-I{include}" for include in tools.includes))
    objects = []
    for suffix, text in SOURCES.items():
        source = folder / f"line.{suffix}"
        source.write_text(text)
        compiler = tools.cc if suffix == "c" else tools.cxx
        objects.append(f"{source}.o")
        trial = try_program(
            (*compiler, *flags, "-c", str(source), "-o", objects[-1]), timeout_s=COMPILE_S
        )
        if trial.end != "done":
            return f"{compiler[0]} {trial.told}"
    trial = try_program(
        (*tools.cxx, "-shared", "-o", str(folder / "line.so"), *objects), timeout_s=COMPILE_S
    )
    return "" if trial.end == "done" else f"linking with {tools.cxx[0]} {trial.told}"
