"""The `workspace` and `stacks` checks: packages and unbuilt messages; running stacks, orphans."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from obelisk_spec.suggestions import with_number
from obk_cli.doctor.finding import Finding, note, ok, warning
from obk_cli.install_source import install_command
from obk_cli.runs.folder import runs_folder
from obk_cli.runs.orphans import find_orphans
from obk_cli.runs.registry import live_runs
from obk_cli.terminal import plain
from obk_cli.workspace.message_build import survey_of
from obk_cli.workspace.package_index import declared_name, find_workspace, package_folders
from obk_interfaces import InterfaceError, NoRosError

__all__ = [
    "RunningStack",
    "StackFacts",
    "WorkspaceFacts",
    "judge_stacks",
    "judge_workspace",
    "probe_stacks",
    "probe_workspace",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspaceFacts:
    """The workspace around the working folder."""

    folder: str | None
    """None: the working folder is not in a workspace."""
    packages: tuple[str, ...]
    broken: tuple[str, ...]
    """`package.xml` files without a name."""
    doubled: tuple[str, ...]
    """Names that more than one folder uses."""
    unbuilt: tuple[str, ...]
    """Message packages that are not built, or changed since the last build."""
    fault: str = ""
    """Why the message packages cannot be examined; empty if they can."""
    fix: str = "obk build"
    """A command that removes the fault, or shows more of it."""


def judge_workspace(facts: WorkspaceFacts) -> Iterator[Finding]:
    """Report the workspace, its packages, and its message packages."""
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
        yield warning(f"message packages: {facts.fault}", facts.fix)
    if facts.unbuilt:
        yield note(
            f"message packages to be built: {', '.join(facts.unbuilt)}",
            f"obk build {' '.join(facts.unbuilt)}",
            unbuilt=facts.unbuilt,
        )


def probe_workspace(working_folder: Path, environment: Mapping[str, str]) -> WorkspaceFacts:
    """Examine the sources of the workspace that contains a folder."""
    workspace = find_workspace(working_folder)
    names = {folder: declared_name(folder) for folder in package_folders(workspace)}
    if not names:
        return WorkspaceFacts(folder=None, packages=(), broken=(), doubled=(), unbuilt=())
    counts = Counter(name for name in names.values() if name is not None)
    unbuilt: tuple[str, ...] = ()
    fault, fix = "", "obk build"
    try:
        unbuilt = tuple(one.name for one in survey_of(workspace, environment).stale)
    except NoRosError as error:
        fault, fix = str(error), install_command("ros")
    except InterfaceError as error:
        fault = str(error)
    return WorkspaceFacts(
        folder=str(workspace),
        packages=tuple(sorted(counts)),
        broken=tuple(str(folder / "package.xml") for folder, name in names.items() if name is None),
        doubled=tuple(sorted(name for name, count in counts.items() if count > 1)),
        unbuilt=unbuilt,
        fault=fault,
        fix=fix,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RunningStack:
    """A stack whose launcher is alive."""

    name: str
    domain: int
    pid: int
    """Process ID of its launcher."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StackFacts:
    """This user's stacks on this host."""

    running: tuple[RunningStack, ...]
    orphans: tuple[str, ...]
    """Process ID and command of processes whose launcher has exited."""


def judge_stacks(facts: StackFacts) -> Iterator[Finding]:
    """Report running stacks, and processes that should have ended."""
    for stack in facts.running:
        yield note(
            f"stack `{stack.name}` is running in ROS domain {stack.domain} (launcher {stack.pid})",
            f"obk stop {stack.name}",
            domain=stack.domain,
            pid=stack.pid,
        )
    if facts.orphans:
        count = len(facts.orphans)
        yield warning(
            f"{count} process{'' if count == 1 else 'es'} outlived the launcher: "
            f"{'; '.join(facts.orphans[:3])}",
            "obk reap",
            orphans=facts.orphans,
        )
    if not facts.running and not facts.orphans:
        yield ok("no stack is running, and no process is left over")


def probe_stacks(environment: Mapping[str, str]) -> StackFacts:
    """Find running launchers, and processes whose launcher has exited."""
    parent = runs_folder(environment)
    return StackFacts(
        running=tuple(
            RunningStack(name=run.name, domain=run.domain, pid=run.pid) for run in live_runs(parent)
        ),
        orphans=tuple(f"{left.pid} {plain(left.command)}" for left in find_orphans(parent)),
    )
