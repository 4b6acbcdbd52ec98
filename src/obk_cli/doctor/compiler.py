"""Can message packages be compiled here? Facts in, findings out."""

from collections.abc import Iterator
from dataclasses import dataclass

from obk_cli.doctor.finding import Finding, ok, warning

__all__ = ["CompilerFacts", "judge_compiler"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CompilerFacts:
    """A line that includes Python.h, compiled in C and C++ and linked."""

    commands: tuple[str, ...]
    """The compilers, C first; empty where one is missing."""
    fault: str
    """Why it did not work, with what to do in brackets where it is known; empty: it did."""
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
