"""Check `compiler`: compile and link C and C++ against Python's headers, as `obk build` does."""

import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obk_cli.doctor.child import try_program
from obk_cli.doctor.finding import Finding, ok, warning
from obk_interfaces.errors import BuildToolError
from obk_interfaces.toolchain import Toolchain, find_toolchain

__all__ = ["CompilerFacts", "judge_compiler", "probe_compiler"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CompilerFacts:
    """A line that includes Python.h, compiled in C and C++ and linked."""

    commands: tuple[str, ...]
    """The compilers, C first; empty where one is missing."""
    fault: str
    """Why it failed, with a known fix in brackets; empty: it worked."""
    cure: str = ""


def judge_compiler(facts: CompilerFacts) -> Iterator[Finding]:
    """Whether `obk build` can work."""
    if facts.fault:
        yield warning(
            f"message packages cannot be built: {facts.fault}",
            facts.cure or "apt install g++ python3-dev",
        )
        return
    yield ok(f"{' and '.join(facts.commands)} compile and link against Python's headers")


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
    """Unset the compilers that the user chose; empty if the user chose none."""
    chosen = [name for name in ("CC", "CXX") if os.environ.get(name)]
    return f"unset {' '.join(chosen)}" if chosen else ""


def _fault(tools: Toolchain, folder: Path) -> str:
    """The error of a compiler or the linker, empty if there was none."""
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
            return f"{compiler[0]} {trial.outcome}"
    trial = try_program(
        (*tools.cxx, "-shared", "-o", str(folder / "line.so"), *objects), timeout_s=COMPILE_S
    )
    return "" if trial.end == "done" else f"linking with {tools.cxx[0]} {trial.outcome}"
