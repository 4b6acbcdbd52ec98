"""The `interfaces` check: whether Obelisk's message packages load and match their sources."""

import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import obk_cli
from obelisk_spec.names import OBELISK_MESSAGES
from obk_cli.doctor.child import child_command, json_output, try_program
from obk_cli.doctor.finding import Finding, error, ok, warning
from obk_cli.install_source import install_command
from obk_cli.optional_deps import distribution_version
from obk_interfaces.errors import BuildToolError
from obk_interfaces.toolchain import Toolchain, find_toolchain

__all__ = [
    "CompilerFacts",
    "InterfaceFacts",
    "judge_compiler",
    "judge_interfaces",
    "probe_compiler",
    "probe_interfaces",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class InterfaceFacts:
    """The compiled messages of this environment."""

    version: str | None
    """Version of the obelisk-interfaces distribution; None if the messages come from elsewhere."""
    faults: Mapping[str, str]
    """Package -> why its compiled part cannot be loaded."""
    loaded: tuple[str, ...]
    stale: tuple[str, ...]
    """Definitions in this checkout that changed since they were compiled."""
    has_sources: bool
    """Whether obk runs from a checkout with the definitions."""


def judge_interfaces(facts: InterfaceFacts) -> Iterator[Finding]:
    """Report packages that do not load or are out of date."""
    fix = "make setup" if facts.has_sources else install_command("ros")
    for package, fault in facts.faults.items():
        yield error(f"the messages of {package} cannot be used: {fault}", fix)
    if facts.stale:
        yield warning(
            f"changed since they were compiled: {', '.join(facts.stale)}", fix, stale=facts.stale
        )
    if facts.loaded:
        named = f"obelisk-interfaces {facts.version}" if facts.version else "Obelisk's messages"
        yield ok(f"{named}: {', '.join(facts.loaded)}", packages=facts.loaded)


LOAD_S: Final = 20.0


def probe_interfaces() -> InterfaceFacts:
    """Load each package in a child, and compare its definitions with the sources."""
    command = child_command("interfaces", *OBELISK_MESSAGES)
    trial = try_program(command, timeout_s=LOAD_S)
    no_output = f"the process that loaded them {trial.outcome}"
    answers: dict[str, str] = json_output(trial) or dict.fromkeys(OBELISK_MESSAGES, no_output)
    sources = Path(obk_cli.__file__).resolve().parents[2] / "interfaces"
    return InterfaceFacts(
        version=distribution_version("obelisk-interfaces"),
        faults={package: fault for package, fault in answers.items() if fault},
        loaded=tuple(package for package, fault in answers.items() if not fault),
        stale=tuple(_stale(sources, Path(sys.prefix) / "share")),
        has_sources=sources.is_dir(),
    )


def _stale(sources: Path, share: Path) -> Iterator[str]:
    """Definitions whose installed copy differs or is missing."""
    for package in OBELISK_MESSAGES:
        installed = share / package
        if not installed.is_dir():
            continue  # it comes from a sourced ROS 2
        for source in sorted((sources / package).glob("*/*.[ms][sr][gv]")):
            name = source.relative_to(sources)
            copy = share / name
            if not copy.is_file() or copy.read_bytes() != source.read_bytes():
                yield str(name)


@dataclass(frozen=True, slots=True, kw_only=True)
class CompilerFacts:
    """The result of compiling and linking a line that includes Python.h, in C and C++."""

    commands: tuple[str, ...]
    """The compilers, C first; empty if one is missing."""
    fault: str
    """Why it failed, with a known fix in brackets; empty if it worked."""
    fix: str = ""


def judge_compiler(facts: CompilerFacts) -> Iterator[Finding]:
    """Report whether `obk build` can work."""
    if facts.fault:
        yield warning(
            f"message packages cannot be built: {facts.fault}",
            facts.fix or "apt install g++ python3-dev",
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
        return CompilerFacts(commands=(), fault=missing.sentence, fix=missing.fix or _fix())
    commands = (" ".join(tools.cc), " ".join(tools.cxx))
    with tempfile.TemporaryDirectory(prefix="obk-doctor-") as folder:
        return CompilerFacts(commands=commands, fault=_fault(tools, Path(folder)), fix=_fix())


def _fix() -> str:
    """A command that unsets the compilers chosen by the user; empty if there are none."""
    chosen = [name for name in ("CC", "CXX") if os.environ.get(name)]
    return f"unset {' '.join(chosen)}" if chosen else ""


def _fault(tools: Toolchain, folder: Path) -> str:
    """The error of a compiler or the linker; empty if there was none."""
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
