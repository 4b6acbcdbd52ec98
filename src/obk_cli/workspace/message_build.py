"""Compile the message packages of a workspace into its overlay."""

import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from shutil import rmtree
from typing import Literal

from obelisk_spec.suggestions import did_you_mean
from obk_cli.clock import monotonic_s
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.plan.plan import Plan
from obk_cli.workspace.overlay import (
    Builder,
    BuiltPackage,
    OverlayRecord,
    build_folder,
    build_lock,
    new_overlay,
    overlay_folder,
    overlay_prefixes,
    read_record,
    replace_overlay,
    underlays_of,
)
from obk_cli.workspace.package_index import PackageIndex, package_folders, package_names_in
from obk_interfaces import (
    KINDS,
    InterfacePackage,
    PackageError,
    Prefixes,
    Progress,
    build,
    definition_files,
    digest_of,
    find_ros_prefix,
    load_package,
    missing_definitions,
    order_by_dependency,
    remove_package,
)

__all__ = [
    "BuildCallbacks",
    "BuildOptions",
    "BuildResult",
    "Survey",
    "build_workspace",
    "choose",
    "colcon_command",
    "find_colcon",
    "find_message_packages",
    "needed_packages",
    "refuse_conflicts",
    "survey_of",
    "survey_workspace",
]

_WORD = re.compile(r"[A-Za-z]\w+")
_MESSAGE_MODULE = re.compile(r"\b(\w+)\.(?:msg|srv|action)\b")

State = Literal["built", "missing", "changed", "installed"]
"""`installed`: an underlay has the same definitions, so the overlay does not need the package."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyedPackage:
    """One message package of the workspace."""

    package: InterfacePackage
    state: State
    digest: str
    """Digest of everything that it would be built from; empty if it is installed."""

    @property
    def name(self) -> str:
        """The package's name."""
        return self.package.name

    @property
    def is_stale(self) -> bool:
        """Whether it must be built before it is used."""
        return self.state in ("missing", "changed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """The message packages of a workspace, in dependency order."""

    workspace: Path
    packages: tuple[SurveyedPackage, ...]
    removed: tuple[str, ...]
    """Packages in the overlay that the workspace no longer has, or that are now installed."""
    ros: str
    conflicts: "tuple[Conflict, ...]"

    @property
    def stale(self) -> tuple[SurveyedPackage, ...]:
        """Packages that must be built."""
        return tuple(package for package in self.packages if package.is_stale)

    @property
    def is_current(self) -> bool:
        """Whether a build would not change the overlay."""
        return not self.stale and not self.removed


@dataclass(frozen=True, slots=True, kw_only=True)
class Conflict:
    """Two packages with the same name but different definitions; the first is used."""

    name: str
    used: Path
    other: Path

    def __str__(self) -> str:
        return f"two packages are named {self.name}: {self.used} and {self.other}"


def find_message_packages(
    workspace: Path,
) -> tuple[tuple[InterfacePackage, ...], tuple[Conflict, ...]]:
    """The packages of a workspace with a definition in msg/, srv/ or action/, in build order.

    If two packages have the same name, the first is used, as for executables.

    Raises:
        PackageError: a manifest cannot be read.
        DependencyError: packages depend on each other in a cycle.
    """
    found: dict[str, InterfacePackage] = {}
    conflicts: list[Conflict] = []
    for folder in package_folders(workspace):
        if not any(next(definition_files(folder, kind), None) for kind in KINDS):
            continue
        package = load_package(folder)
        first = found.setdefault(package.name, package)
        files = {interface.file for interface in first.interfaces}
        if first is not package and not _has_same(package, first.root, files):
            conflicts.append(Conflict(name=first.name, used=first.root, other=package.root))
    return order_by_dependency(found.values()), tuple(conflicts)


def needed_packages(plan: Plan, packages: PackageIndex) -> frozenset[str]:
    """The packages that a stack uses: those of its nodes and messages, and their dependencies.

    A dependency is declared in the manifest, or implied by an import of messages.
    """
    ends = (end for node in plan.nodes for end in (*node.publishes, *node.subscribes))
    todo = [end.msg_type.partition("/")[0] for end in ends if end.msg_type]
    todo += [node.package for node in plan.nodes]
    needed: set[str] = set()
    while todo:
        name = todo.pop()
        source = packages.source_packages.get(name)
        if name in needed or source is None:
            continue
        needed.add(name)
        todo += _named_in(source)
    return frozenset(needed)


def _named_in(source: Path) -> Iterator[str]:
    """The packages mentioned in a package's manifest, CMakeLists.txt and Python code."""
    for file in (source / "package.xml", source / "CMakeLists.txt"):
        if file.is_file():
            yield from _WORD.findall(file.read_text(encoding="utf-8", errors="replace"))
    for file in source.rglob("*.py"):
        if file.is_file():
            yield from _MESSAGE_MODULE.findall(file.read_text(encoding="utf-8", errors="replace"))


def refuse_conflicts(survey: Survey, names: Collection[str]) -> None:
    """Reject duplicate packages if these packages, or their dependencies, include them.

    Raises:
        PackageError: for the first such conflict.
    """
    needed = set(names)
    for one in reversed(survey.packages):
        if one.name in needed:
            needed.update(one.package.depends)
    for conflict in survey.conflicts:
        if conflict.name in needed:
            raise PackageError(f"{conflict}; put a file COLCON_IGNORE into one of them")


def survey_workspace(workspace: Path, underlays: Sequence[Path]) -> Survey:
    """Compare the packages of a workspace with those from which its overlay was built.

    Raises:
        PackageError: a manifest cannot be read.
        DependencyError: packages depend on each other in a cycle.
        BuildToolError: there are packages, but no ROS 2 to build them against.
    """
    packages, conflicts = find_message_packages(workspace)
    record = read_record(workspace)
    if not packages:
        removed = tuple(record.packages) if record else ()
        return Survey(workspace=workspace, packages=(), removed=removed, ros="", conflicts=())
    prefixes = Prefixes(layers=tuple(underlays), ros=find_ros_prefix())
    surveyed: dict[str, SurveyedPackage] = {}
    for package in packages:
        surveyed[package.name] = _survey(package, surveyed, prefixes, record)
    kept = {one.name for one in surveyed.values() if one.state != "installed"}
    return Survey(
        workspace=workspace,
        packages=tuple(surveyed.values()),
        removed=tuple(name for name in (record.packages if record else ()) if name not in kept),
        ros=str(prefixes.ros),
        conflicts=conflicts,
    )


def _survey(
    package: InterfacePackage,
    before: Mapping[str, SurveyedPackage],
    prefixes: Prefixes,
    record: OverlayRecord | None,
) -> SurveyedPackage:
    own = [before[name] for name in package.depends if name in before]
    needs = [one for one in own if one.state != "installed"]
    share = prefixes.share_of(package.name)
    if not needs and share is not None and _has_same(package, share, set(_definitions(share))):
        return SurveyedPackage(package=package, state="installed", digest="")
    digest = digest_of(package, prefixes, built_with=(one.digest for one in needs))
    built = record.packages.get(package.name) if record else None
    state: State = "missing" if built is None else "changed"
    if built is not None and built.digest == digest:
        state = "built"
    return SurveyedPackage(package=package, state=state, digest=digest)


def _has_same(package: InterfacePackage, folder: Path, files: set[str]) -> bool:
    """Whether a folder has exactly these definitions of a package."""
    own = {interface.file for interface in package.interfaces}
    return own == files and all(
        (package.root / file).read_bytes() == (folder / file).read_bytes() for file in own
    )


def _definitions(share: Path) -> Iterable[str]:
    for kind in ("msg", "srv", "action"):
        yield from (f"{kind}/{file.name}" for file in share.glob(f"{kind}/*.{kind}"))


def choose(
    survey: Survey, names: Collection[str], *, present: Collection[str]
) -> list[SurveyedPackage]:
    """The packages to build, in build order; all of them if no names are given.

    With names: those packages, their dependencies, and packages `present` in the overlay that
    depend on them, because these must not stay compiled against an older version.

    Raises:
        MisuseError: the workspace has no message package with a given name.
    """
    known = {one.name: one for one in survey.packages}
    for name in names:
        if name not in known:
            raise MisuseError(
                f"no message package is named `{name}` in {survey.workspace}",
                help=did_you_mean(name, known) or "create one with `obk new msgs my_msgs`",
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
    """The command that builds these packages of the current folder with colcon."""
    workers = ("--parallel-workers", str(jobs)) if jobs is not None else ()
    return (colcon, "build", *workers, "--packages-select", *packages)


def find_colcon(environment: Mapping[str, str]) -> Path | None:
    """The colcon program; None if it is not installed, or nodes would use no sourced ROS 2.

    In an environment with ROS wheels, a sourced ROS 2 is ignored and not on AMENT_PREFIX_PATH.
    """
    program = shutil.which("colcon", path=environment.get("PATH"))
    own = Path(sys.prefix)
    listed = (
        Path(prefix) for prefix in environment.get("AMENT_PREFIX_PATH", "").split(":") if prefix
    )
    is_sourced = any(p != own and (p / "lib" / "librcl.so").exists() for p in listed)
    return Path(program) if program and is_sourced else None


def run_colcon(arguments: Sequence[str], workspace: Path, environment: Mapping[str, str]) -> None:
    """Run colcon in a workspace until it ends; its output goes to stderr.

    Raises:
        CommandFailedError: colcon failed.
    """
    try:
        done = subprocess.run(
            arguments, cwd=workspace, env=environment, stdout=sys.stderr, check=False
        )
    except OSError as error:
        raise CommandFailedError(f"{arguments[0]} cannot be run: {error.strerror}") from error
    if done.returncode:
        raise CommandFailedError(
            f"`{' '.join(arguments)}` failed with exit code {done.returncode}",
            help="see colcon's output above, or in the folder log/ of the workspace",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildOptions:
    """The options of a build."""

    environment: Mapping[str, str]
    """AMENT_PREFIX_PATH lists the underlays; colcon is searched on PATH."""
    names: tuple[str, ...] = ()
    """Packages to build; empty: all."""
    is_clean: bool = False
    """Whether previous build results are removed."""
    jobs: int | None = None
    """Number of parallel compilers; None: the number of processors."""
    only_messages: bool = False
    """Whether colcon skips packages without messages."""
    needed: frozenset[str] | None = None
    """The packages that a stack uses; None: any package of the workspace may be used."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildCallbacks:
    """Callbacks for the progress of a build."""

    on_progress: Callable[[Progress], None] = lambda _: None
    on_note: Callable[[str], None] = lambda _: None
    """Receives notes, such as waiting for another build, or the command of colcon."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildResult:
    """The result of a build; names are in build order."""

    workspace: Path
    overlay: Path
    builder: Builder
    prefixes: tuple[Path, ...]
    """Where the packages are now; these prefixes go before all others."""
    built: tuple[str, ...]
    unchanged: tuple[str, ...]
    installed: tuple[str, ...]
    """Packages with the same definitions in an underlay."""
    removed: tuple[str, ...]
    duration_s: float = field(compare=False)


def survey_of(workspace: Path, environment: Mapping[str, str]) -> Survey:
    """The survey for a build in this environment.

    Raises:
        obk_interfaces.InterfaceError: a package cannot be read, or ROS 2 is missing.
    """
    own = (overlay_folder(workspace), *overlay_prefixes((workspace,)))
    return survey_workspace(workspace, underlays_of(environment, own))


def build_workspace(
    workspace: Path, options: BuildOptions, callbacks: BuildCallbacks | None = None
) -> BuildResult:
    """Build the message packages of a workspace that have changed.

    If two builds run at once, the second waits.

    Raises:
        MisuseError: a name does not match a message package of the workspace.
        CommandFailedError: colcon failed, the workspace cannot be written, or another build of it
            does not end.
        obk_interfaces.InterfaceError: a definition is invalid, or the compiler failed.
    """
    started = monotonic_s()
    reported = callbacks or BuildCallbacks()
    colcon = find_colcon(options.environment)
    survey = survey_of(workspace, options.environment)
    for one in _check(survey, options):
        for file in missing_definitions(one.package.root):
            cmake = one.package.root / "CMakeLists.txt"
            reported.on_note(f"warning: {cmake} names `{file}`, which does not exist")
    if _has_nothing_to_do(survey, options, colcon):
        return _outcome(survey, (), started)
    with build_lock(workspace, reported.on_note):
        # Another build may have finished in the meantime.
        survey = survey_of(workspace, options.environment)
        chosen = _check(survey, options)
        if colcon is not None:
            built = _by_colcon(survey, chosen, colcon, options, reported)
        else:
            built = _by_engine(survey, chosen, options, reported)
        return _outcome(survey, built, started)


def _check(survey: Survey, options: BuildOptions) -> list[SurveyedPackage]:
    known = [one.name for one in survey.packages]
    refuse_conflicts(survey, options.names or (known if options.needed is None else options.needed))
    record = read_record(survey.workspace)
    return choose(survey, options.names, present=record.packages if record else ())


def _has_nothing_to_do(survey: Survey, options: BuildOptions, colcon: Path | None) -> bool:
    if colcon is not None and not options.only_messages:
        return False  # only colcon knows what else it builds
    return survey.is_current and not options.is_clean


def _by_engine(
    survey: Survey,
    chosen: Sequence[SurveyedPackage],
    options: BuildOptions,
    callbacks: BuildCallbacks,
) -> tuple[str, ...]:
    workspace = survey.workspace
    if options.is_clean:
        for one in chosen:
            rmtree(build_folder(workspace) / one.name, ignore_errors=True)
    stays = bool(options.names) or not options.is_clean
    record = read_record(workspace)
    is_own = record is not None and record.builder == "obk"
    stage = new_overlay(workspace, with_current=stays and is_own)
    try:
        built = _build_into(stage, survey, chosen, options, callbacks)
    except BaseException:
        rmtree(stage, ignore_errors=True)
        raise
    replace_overlay(workspace, stage, _record(survey, chosen, "obk", (".",)))
    return built


def _build_into(
    stage: Path,
    survey: Survey,
    chosen: Sequence[SurveyedPackage],
    options: BuildOptions,
    callbacks: BuildCallbacks,
) -> tuple[str, ...]:
    for name in survey.removed:
        remove_package(name, stage)
        rmtree(build_folder(survey.workspace) / name, ignore_errors=True)
    if not chosen:
        return ()
    report = build(
        [one.package for one in chosen],
        build_dir=build_folder(survey.workspace),
        prefix=stage,
        underlays=underlays_of(options.environment, [overlay_folder(survey.workspace)]),
        jobs=options.jobs,
        on_progress=callbacks.on_progress,
    )
    return report.built


def _by_colcon(
    survey: Survey,
    chosen: Sequence[SurveyedPackage],
    colcon: Path,
    options: BuildOptions,
    callbacks: BuildCallbacks,
) -> tuple[str, ...]:
    workspace = survey.workspace
    names = [one.name for one in chosen]
    if not options.names and not options.only_messages:
        names = [*package_names_in(workspace)]
    if options.is_clean:
        for name in names:
            rmtree(workspace / "build" / name, ignore_errors=True)
            rmtree(workspace / "install" / name, ignore_errors=True)
    if names:
        command = colcon_command(str(colcon), names, jobs=options.jobs)
        callbacks.on_note(f"building with the sourced ROS 2: {' '.join(command)}")
        run_colcon(command, workspace, options.environment)
    stage = new_overlay(workspace, with_current=False)
    prefixes = _colcon_prefixes(workspace, [one.name for one in chosen])
    replace_overlay(workspace, stage, _record(survey, chosen, "colcon", prefixes))
    return tuple(names)


def _colcon_prefixes(workspace: Path, names: Sequence[str]) -> tuple[str, ...]:
    """The prefixes in which colcon has installed packages: one for all, or one for each."""
    install = workspace / "install"
    merged = [install] if (install / "share").is_dir() else []
    alone = [install / name for name in names if (install / name / "share").is_dir()]
    return tuple(map(str, merged or reversed(alone)))


def _record(
    survey: Survey, chosen: Sequence[SurveyedPackage], builder: Builder, prefixes: tuple[str, ...]
) -> OverlayRecord:
    """The record of the new overlay; unchanged packages keep their entry of the old one."""
    before = read_record(survey.workspace)
    packages = dict(before.packages) if before and before.builder == builder else {}
    known = {one.name for one in survey.packages}
    kept = {name: built for name, built in packages.items() if name in known - set(survey.removed)}
    for one in chosen:
        source = one.package.root
        if source.is_relative_to(survey.workspace):
            source = source.relative_to(survey.workspace)
        kept[one.name] = BuiltPackage(source=str(source), digest=one.digest)
    old = before.prefixes if before and before.builder == builder else ()
    return OverlayRecord(
        builder=builder,
        python=platform.python_version(),
        ros=survey.ros,
        prefixes=tuple(dict.fromkeys((*prefixes, *old))),
        packages=kept,
    )


def _outcome(survey: Survey, built: tuple[str, ...], started: float) -> BuildResult:
    record = read_record(survey.workspace)
    present = record.packages if record else {}
    return BuildResult(
        workspace=survey.workspace,
        overlay=overlay_folder(survey.workspace),
        builder=record.builder if record else "obk",
        prefixes=overlay_prefixes((survey.workspace,)),
        built=built,
        unchanged=tuple(
            one.name for one in survey.packages if one.name in present and one.name not in built
        ),
        installed=tuple(one.name for one in survey.packages if one.state == "installed"),
        removed=survey.removed,
        duration_s=monotonic_s() - started,
    )
