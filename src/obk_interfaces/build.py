"""Build packages: check, generate, compile, link and install, in this order.

The calling thread generates sources while compilers process the finished ones. Nothing is installed
unless everything was built. A package with an unchanged fingerprint is not rebuilt.
"""

import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from obk_interfaces.definition import check_package
from obk_interfaces.errors import CommandError, DefinitionError, DependencyError
from obk_interfaces.generate import generate
from obk_interfaces.package import InterfacePackage, PackageTree, order_by_dependency
from obk_interfaces.prefix import Prefixes, assemble, find_ros_prefix, install_into, is_installed
from obk_interfaces.toolchain import (
    SharedLibrary,
    Toolchain,
    compile_command,
    find_toolchain,
    include_flags,
    libraries_of,
    library_path,
    link_command,
    object_of,
    write_units,
)

__all__ = ["BuildReport", "Progress", "ProgressCallback", "build", "digest_of"]

Step: TypeAlias = Literal["unchanged", "generate", "compile", "link", "install"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """Progress of a build: `done` of `total` items of a step are finished."""

    step: Step
    subject: str
    done: int
    total: int


ProgressCallback: TypeAlias = Callable[[Progress], None]


def fingerprint_of(package: InterfacePackage, prefixes: Prefixes, toolchain: Toolchain) -> str:
    """Digest everything that `digest_of` covers, and the compiler."""
    words = (digest_of(package, prefixes), *toolchain.cc, *toolchain.cxx)
    return hashlib.sha256(b"\0".join(word.encode() for word in words)).hexdigest()


def digest_of(
    package: InterfacePackage, prefixes: Prefixes, *, built_with: Iterable[str] = ()
) -> str:
    """Digest the package, its dependencies, this engine, the Python and the ROS installation.

    `built_with` are digests of dependencies that are in no prefix.
    """
    digest = hashlib.sha256()
    for word in (sys.version, str(prefixes.ros), *built_with):
        digest.update(word.encode() + b"\0")
    files = [package.root / "package.xml", *(package.root / i.file for i in package.interfaces)]
    for file in (*files, *_files_of_dependencies(package, prefixes), *_files_of_engine()):
        digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def _files_of_dependencies(package: InterfacePackage, prefixes: Prefixes) -> Iterable[Path]:
    for _, share in sorted(prefixes.closure(package).items()):
        yield from sorted(share.glob("*/*.idl"))


def _files_of_engine() -> Iterable[Path]:
    return sorted(Path(__file__).parent.glob("*.py"))


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildReport:
    """The result of a build, with names of packages in build order."""

    built: tuple[str, ...]
    unchanged: tuple[str, ...]
    prefix: Path
    duration_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Job:
    """A package being built: its folders, dependencies, and libraries with their objects."""

    tree: PackageTree
    prefixes: Prefixes
    fingerprint: str
    libraries: tuple[tuple[SharedLibrary, tuple[Path, ...]], ...]
    compiles: tuple[tuple[str, ...], ...]


def build(
    packages: Iterable[InterfacePackage],
    *,
    build_dir: Path,
    prefix: Path,
    underlays: Sequence[Path] = (),
    jobs: int | None = None,
    on_progress: ProgressCallback = lambda _: None,
) -> BuildReport:
    """Build packages and install them to a prefix.

    Args:
        packages: the packages to build, in any order.
        build_dir: scratch folder; if it is kept, later builds skip unchanged packages.
        prefix: receives `lib/`, `include/` and `share/`; installed packages can be dependencies.
        underlays: further prefixes whose packages may be used, nearest first.
        jobs: number of parallel compilers; None for the number of processors.
        on_progress: called in this thread after each item.

    Raises:
        DefinitionError: message definitions are invalid.
        DependencyError: a dependency is not found, or packages depend on each other in a cycle.
        BuildToolError: compiler, headers or generators are missing.
        CommandError: a compiler or a generator failed.
    """
    started = time.perf_counter()
    build_dir, prefix = build_dir.resolve(), prefix.resolve()
    ordered = order_by_dependency(packages)
    prefixes = Prefixes(layers=(prefix, *underlays), ros=find_ros_prefix())
    _check(ordered, prefixes)
    toolchain = find_toolchain()
    trees = [PackageTree(package=p, root=build_dir / p.name) for p in ordered]
    finished = _update(trees, prefixes, toolchain, jobs or os.cpu_count() or 1, on_progress)
    for done, tree in enumerate(trees, start=1):
        if not is_installed(tree, prefix):
            install_into(tree, prefix)
        on_progress(_progress("install", tree.package.name, done, len(trees)))
    return BuildReport(
        built=finished,
        unchanged=tuple(p.name for p in ordered if p.name not in finished),
        prefix=prefix,
        duration_s=time.perf_counter() - started,
    )


def _check(packages: Sequence[InterfacePackage], prefixes: Prefixes) -> None:
    """Report all errors together that would otherwise stop the build halfway."""
    by_name = {package.name: package for package in packages}
    for package in packages:
        interfaces = (d for d in package.depends if d.endswith(("_msgs", "_interfaces")))
        missing = [d for d in interfaces if d not in by_name and prefixes.share_of(d) is None]
        if missing:
            searched = ", ".join(str(p) for p in prefixes.all)
            raise DependencyError(
                f"{package.root / 'package.xml'}: {package.name} depends on {', '.join(missing)}, "
                f"found neither among the packages to build nor in {searched}"
            )
    problems = [x for package in packages for x in check_package(package, by_name, prefixes)]
    if problems:
        raise DefinitionError(problems)


def _update(
    trees: Sequence[PackageTree],
    prefixes: Prefixes,
    toolchain: Toolchain,
    workers: int,
    on_progress: ProgressCallback,
) -> tuple[str, ...]:
    """Update each package's own prefix, and return the names of the rebuilt packages."""
    jobs: list[_Job] = []
    compiles: list[Future[None]] = []
    pool = ThreadPoolExecutor(workers)
    try:
        for done, tree in enumerate(trees, start=1):
            fingerprint = fingerprint_of(tree.package, prefixes, toolchain)
            step: Step = "unchanged"
            if not _is_built(tree, fingerprint):
                step = "generate"
                job = _prepare(tree, prefixes, toolchain, fingerprint)
                jobs.append(job)
                compiles += [
                    pool.submit(_run, command, f"{tree.package.name}: the compiler failed")
                    for command in job.compiles
                ]
            prefixes = prefixes.above(tree.install)
            on_progress(_progress(step, tree.package.name, done, len(trees)))
        for done, future in enumerate(as_completed(compiles), start=1):
            future.result()
            on_progress(_progress("compile", "", done, len(compiles)))
    finally:
        pool.shutdown(cancel_futures=True)
    for done, job in enumerate(jobs, start=1):
        _link(job, toolchain)
        on_progress(_progress("link", job.tree.package.name, done, len(jobs)))
    return tuple(job.tree.package.name for job in jobs)


def _is_built(tree: PackageTree, fingerprint: str) -> bool:
    return tree.fingerprint.is_file() and tree.fingerprint.read_text() == fingerprint


def _prepare(tree: PackageTree, prefixes: Prefixes, toolchain: Toolchain, fingerprint: str) -> _Job:
    """Generate a package and plan its compilation."""
    tree.clear()
    generate(tree, prefixes)
    assemble(tree)
    includes = include_flags(tree, prefixes, toolchain)
    libraries, compiles = [], []
    for library in libraries_of(tree, prefixes.closure(tree.package)):
        objects = []
        for unit in write_units(library, tree.objects):
            target = object_of(library, unit, tree.objects)
            command = compile_command(
                unit, target, tree=tree, includes=includes, toolchain=toolchain
            )
            objects.append(target)
            compiles.append(command)
        libraries.append((library, tuple(objects)))
    return _Job(
        tree=tree,
        prefixes=prefixes,
        fingerprint=fingerprint,
        libraries=tuple(libraries),
        compiles=tuple(compiles),
    )


def _link(job: _Job, toolchain: Toolchain) -> None:
    """Link the libraries of a package, then write its fingerprint to mark it as complete."""
    for library, objects in job.libraries:
        library_path(library, job.tree.install).parent.mkdir(parents=True, exist_ok=True)
        command = link_command(
            library, objects, tree=job.tree, prefixes=job.prefixes, toolchain=toolchain
        )
        _run(command, f"{job.tree.package.name}: linking {library.file} failed")
    job.tree.fingerprint.write_text(job.fingerprint)


def _run(command: Sequence[str], failure: str) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        raise CommandError(
            f"{failure}, exit code {result.returncode}",
            output=result.stderr[:4000],
            command=tuple(command),
        )


def _progress(step: Step, subject: str, done: int, total: int) -> Progress:
    return Progress(step=step, subject=subject, done=done, total=total)
