"""Is the folder that one stands in a workspace, and is what it builds up to date? Pure."""

from collections.abc import Iterator
from dataclasses import dataclass

from obelisk_spec.wording import with_number
from obk_cli.doctor.finding import Finding, note, ok, warning

__all__ = ["WorkspaceFacts", "judge_workspace"]


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspaceFacts:
    """The workspace around the working folder."""

    folder: str | None
    """None: the working folder is in none."""
    packages: tuple[str, ...]
    broken: tuple[str, ...]
    """`package.xml` files without a name."""
    doubled: tuple[str, ...]
    """Names that more than one folder claims."""
    unbuilt: tuple[str, ...]
    """Message packages that are not built, or changed since."""
    fault: str = ""
    """Why it cannot be told which message packages are built; empty: it can."""


def judge_workspace(facts: WorkspaceFacts) -> Iterator[Finding]:
    """The workspace, its packages, and its message packages."""
    if facts.folder is None:
        yield note("the working folder is in no workspace", "obk init my_robot")
        return
    yield ok(
        f"workspace {facts.folder}: {with_number(len(facts.packages), 'package')}",
        folder=facts.folder,
        packages=facts.packages,
    )
    for path in facts.broken:
        yield warning(f"{path} has no <name>", f"rm {path}    # or write its <name>")
    for name in facts.doubled:
        yield warning(
            f"several folders hold a package named {name}; one of them is used",
            f"grep -rl '<name>{name}</name>' --include package.xml {facts.folder}",
        )
    if facts.fault:
        yield warning(f"message packages: {facts.fault}", "obk build")
    if facts.unbuilt:
        yield note(
            f"message packages to be built: {', '.join(facts.unbuilt)}",
            f"obk build {' '.join(facts.unbuilt)}",
            unbuilt=facts.unbuilt,
        )
