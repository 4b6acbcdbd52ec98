"""Check `workspace`: packages of the workspace, and message packages that need a build."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obelisk_spec.suggestions import with_number
from obk_cli.doctor.finding import Finding, note, ok, warning
from obk_cli.workspace.message_build import survey_of
from obk_cli.workspace.package_index import find_workspace, package_folders
from obk_interfaces import InterfaceError

__all__ = ["WorkspaceFacts", "judge_workspace", "probe_workspace"]


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
    """Why the message packages cannot be examined; empty: they can."""


def judge_workspace(facts: WorkspaceFacts) -> Iterator[Finding]:
    """The workspace, its packages, and its message packages."""
    if facts.folder is None:
        yield note("the working folder is not in a workspace", "obk init my_robot")
        return
    yield ok(
        f"workspace {facts.folder}: {with_number(len(facts.packages), 'package')}",
        folder=facts.folder,
        packages=facts.packages,
    )
    for path in facts.broken:
        yield warning(f"{path} has no <name>", f"rm {path}    # or add a <name>")
    for name in facts.doubled:
        yield warning(
            f"several packages are named {name}; only one of them is used",
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


_NAME: Final = re.compile(r"<name>\s*([^<\s]+)\s*</name>")


def probe_workspace(working_folder: Path, environment: Mapping[str, str]) -> WorkspaceFacts:
    """Look through the sources of the workspace that a folder is in."""
    workspace = find_workspace(working_folder)
    manifests = [folder / "package.xml" for folder in package_folders(workspace)]
    if not manifests:
        return WorkspaceFacts(folder=None, packages=(), broken=(), doubled=(), unbuilt=())
    names = {path: _NAME.search(path.read_text(errors="replace")) for path in manifests}
    counts = Counter(found[1] for found in names.values() if found)
    unbuilt: tuple[str, ...] = ()
    fault = ""
    try:
        unbuilt = tuple(one.name for one in survey_of(workspace, environment).stale)
    except InterfaceError as error:
        fault = str(error)
    return WorkspaceFacts(
        folder=str(workspace),
        packages=tuple(sorted(counts)),
        broken=tuple(str(path) for path, found in names.items() if not found),
        doubled=tuple(sorted(name for name, count in counts.items() if count > 1)),
        unbuilt=unbuilt,
        fault=fault,
    )
