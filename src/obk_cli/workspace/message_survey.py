"""Find the message packages that an overlay lacks or holds in an old version."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import MisuseError
from obk_cli.workspace.overlay import OverlayRecord, read_record
from obk_cli.workspace.package_index import package_folders
from obk_interfaces import (
    KINDS,
    InterfacePackage,
    PackageError,
    Prefixes,
    definition_files,
    digest_of,
    find_ros_prefix,
    load_package,
    order_by_dependency,
)

__all__ = [
    "Survey",
    "Surveyed",
    "choose",
    "colcon_command",
    "find_message_packages",
    "survey_workspace",
]

State = Literal["built", "missing", "changed", "installed"]
"""`installed`: a prefix below has it with the same definitions, so the overlay needs none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Surveyed:
    """One message package of the workspace."""

    package: InterfacePackage
    state: State
    digest: str
    """Of what it would be built from now; empty if it is installed."""

    @property
    def name(self) -> str:
        """The package's name."""
        return self.package.name

    @property
    def is_stale(self) -> bool:
        """Whether it is to be built before it is used."""
        return self.state in ("missing", "changed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """A workspace's message packages, each after those that it needs."""

    workspace: Path
    packages: tuple[Surveyed, ...]
    gone: tuple[str, ...]
    """Packages that the overlay has and the workspace no more, or installed ones."""
    ros: str

    @property
    def stale(self) -> tuple[Surveyed, ...]:
        """Those to be built."""
        return tuple(package for package in self.packages if package.is_stale)

    @property
    def is_current(self) -> bool:
        """Whether the overlay is what a build would make of it."""
        return not self.stale and not self.gone


def find_message_packages(workspace: Path) -> tuple[InterfacePackage, ...]:
    """The packages of a workspace with a definition in msg/, srv/ or action/, in build order.

    Raises:
        PackageError: a manifest cannot be read, or two packages have one name.
        DependencyError: packages need one another in a circle.
    """
    found: dict[str, InterfacePackage] = {}
    for folder in package_folders(workspace):
        if not any(next(definition_files(folder, kind), None) for kind in KINDS):
            continue
        package = load_package(folder)
        other = found.setdefault(package.name, package)
        if other.root.resolve() != package.root.resolve():  # a link may lead there a second time
            raise PackageError(
                f"two packages are called {package.name}: {other.root} and {package.root}"
            )
    return order_by_dependency(found.values())


def survey_workspace(workspace: Path, underlays: Sequence[Path]) -> Survey:
    """Compare the packages of a workspace with what its overlay was made from.

    Raises:
        PackageError: a manifest cannot be read, or two packages have one name.
        DependencyError: packages need one another in a circle.
        BuildToolError: there are packages, and no ROS 2 to build them against.
    """
    packages = find_message_packages(workspace)
    record = read_record(workspace)
    if not packages:
        gone = tuple(record.packages) if record else ()
        return Survey(workspace=workspace, packages=(), gone=gone, ros="")
    prefixes = Prefixes(layers=tuple(underlays), ros=find_ros_prefix())
    surveyed: dict[str, Surveyed] = {}
    for package in packages:
        surveyed[package.name] = _survey(package, surveyed, prefixes, record)
    kept = {one.name for one in surveyed.values() if one.state != "installed"}
    return Survey(
        workspace=workspace,
        packages=tuple(surveyed.values()),
        gone=tuple(name for name in (record.packages if record else ()) if name not in kept),
        ros=str(prefixes.ros),
    )


def _survey(
    package: InterfacePackage,
    before: Mapping[str, Surveyed],
    prefixes: Prefixes,
    record: OverlayRecord | None,
) -> Surveyed:
    own = [before[name] for name in package.depends if name in before]
    needs = [one for one in own if one.state != "installed"]
    share = prefixes.share_of(package.name)
    if not needs and share is not None and _has_same(package, share):
        return Surveyed(package=package, state="installed", digest="")
    digest = digest_of(package, prefixes, built_with=(one.digest for one in needs))
    built = record.packages.get(package.name) if record else None
    state: State = "missing" if built is None else "changed"
    if built is not None and built.digest == digest:
        state = "built"
    return Surveyed(package=package, state=state, digest=digest)


def _has_same(package: InterfacePackage, share: Path) -> bool:
    """Whether an installed package has the same definitions, and no others."""
    files = {interface.file for interface in package.interfaces}
    return files == set(_definitions(share)) and all(
        (package.root / file).read_bytes() == (share / file).read_bytes() for file in files
    )


def _definitions(share: Path) -> Iterable[str]:
    for kind in ("msg", "srv", "action"):
        yield from (f"{kind}/{file.name}" for file in share.glob(f"{kind}/*.{kind}"))


def choose(survey: Survey, names: Collection[str], *, present: Collection[str]) -> list[Surveyed]:
    """The packages that a build takes, in build order; without names, all.

    With names: those, what they need, and of those that are `present` in the overlay the ones that
    use them: a message must not stay compiled against an older one that is in it.

    Raises:
        MisuseError: the workspace has no message package of a name.
    """
    known = {one.name: one for one in survey.packages}
    for name in names:
        if name not in known:
            raise MisuseError(
                f"there is no message package `{name}` in {survey.workspace}",
                help=did_you_mean(name, known) or "`obk new msgs my_msgs` makes one",
            )
    chosen = set(names or known)
    for one in reversed(survey.packages):
        if one.name in chosen:
            chosen.update(known.keys() & set(one.package.depends))
    for one in survey.packages:
        if one.name in present and not chosen.isdisjoint(one.package.depends):
            chosen.add(one.name)
    return [one for one in survey.packages if one.name in chosen and one.state != "installed"]


def colcon_command(colcon: str, packages: Sequence[str], *, jobs: int | None) -> tuple[str, ...]:
    """The arguments that have colcon build these packages of the folder it is started in."""
    workers = ("--parallel-workers", str(jobs)) if jobs is not None else ()
    return (colcon, "build", *workers, "--packages-select", *packages)
