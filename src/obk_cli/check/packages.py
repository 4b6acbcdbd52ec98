"""OBK401 to OBK404, OBK414: packages, executables and files that the config refers to."""

from collections import defaultdict
from collections.abc import Iterator

from obelisk_spec.names import package_name_fault
from obelisk_spec.suggestions import ask_for, did_you_mean, near_names
from obk_cli.check.context import CheckContext
from obk_cli.config.environment import Environment, ExecutableMissing
from obk_cli.config.model import (
    JOYSTICK_EXECUTABLE,
    JOYSTICK_PACKAGE,
    FileSearch,
    Spanned,
    Stack,
)
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.source import Span

__all__ = [
    "check_executables",
    "check_files",
    "check_manifests",
    "no_such_package",
    "where_it_is_not",
]


def where_it_is_not(search: FileSearch) -> str:
    """A help line with similar files and the paths that were tried."""
    tried = f"tried {', '.join(str(path) for path in search.tried)}"
    near = ask_for(search.near)
    if search.written.value.startswith("~/"):
        near = f"`~` is not expanded, write `${{HOME}}{search.written.value[1:]}`;"
    return f"{near} {tried}" if near else tried


def no_such_package(
    search: FileSearch, package: Spanned[str], what: str, environment: Environment
) -> Diagnostic:
    """A finding about the missing `robot_pkg` of a file; `what` describes the file."""
    near = ask_for(near_names(package.value, environment.package_names()))
    return found(
        "OBK403",
        f"package `{package.value}` of the {what} `{search.written.value}` was not found",
        package.span,
        help=near or where_it_is_not(search),
    )


def check_executables(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that packages and executables exist; a missing package is reported once."""
    missing: dict[str, list[Span]] = defaultdict(list)
    looked: dict[str, str] = {}
    for package, executable in _wanted(context.stack):
        answer = context.environment.find_executable(package.value, executable.value)
        if not isinstance(answer, ExecutableMissing):
            continue
        if answer.package_found:
            yield _no_executable(answer, executable.span)
        else:
            missing[package.value].append(package.span)
            looked[package.value] = answer.looked
    for name, places in missing.items():
        yield _no_package(name, places, looked[name], context.environment)


def _wanted(stack: Stack) -> Iterator[tuple[Spanned[str], Spanned[str]]]:
    """Package and executable of every node, including the joystick."""
    for node in stack.nodes:
        if node.pkg and node.executable and not package_name_fault(node.pkg.value):
            yield node.pkg, node.executable
    for joystick in stack.joysticks:
        if joystick.on:
            span = joystick.span
            yield Spanned(JOYSTICK_PACKAGE, span), Spanned(JOYSTICK_EXECUTABLE, span)


def _no_executable(answer: ExecutableMissing, place: Span) -> Diagnostic:
    if answer.not_executable is not None:
        return found(
            "OBK402",
            f"`{answer.executable}` of package `{answer.package}` exists but is not executable",
            place,
            help=f"run `chmod +x {answer.not_executable}`",
        )
    if answer.unsourced is not None:
        setup = next(p for p in answer.unsourced.parents if p.name == "install") / "setup.bash"
        return found(
            "OBK402",
            f"`{answer.executable}` of package `{answer.package}` is built but not sourced",
            place,
            help=f"run `source {setup}`; it is in {answer.unsourced.parent}",
        )
    if answer.declared_in is not None:
        return found(
            "OBK402",
            f"`{answer.executable}` of package `{answer.package}` is declared in "
            f"{answer.declared_in.name} but not built",
            place,
            help=_build(answer.package),
        )
    if answer.computed_in is not None:
        return found(
            "OBK402",
            f"`{answer.executable}` of package `{answer.package}` does not exist or is not built",
            place,
            help=f"`obk` does not run its {answer.computed_in.name}, which computes names of "
            f"executables: {_build(answer.package)}",
        )
    declare = (
        "executables are declared with `add_executable` or `install(PROGRAMS ...)` in "
        "CMakeLists.txt"
        if answer.is_of_cmake
        else "Python nodes are declared as `console_scripts` in setup.py"
    )
    return found(
        "OBK402",
        f"package `{answer.package}` has no executable `{answer.executable}`",
        place,
        help=did_you_mean(answer.executable, answer.available)
        or f"it has no executables; {declare}",
    )


def _build(package: str) -> str:
    return f"run `colcon build --packages-select {package}` and source `install/setup.bash`"


def _no_package(
    package: str,
    places: list[Span],
    looked: str,
    environment: Environment,
) -> Diagnostic:
    # Message packages have no executables, and their names resemble many others.
    names = [name for name in environment.package_names() if not name.endswith("_msgs")]
    near = ask_for(near_names(package, names))
    if package == JOYSTICK_PACKAGE:
        near = "install it to use the joystick, or set `on: false`;"
    elif package.startswith("obelisk_") and package.endswith("_cpp"):
        # Similar names include the package that has the same nodes in Python.
        twin = f"{package.removesuffix('cpp')}py"
        in_python = (
            f", or use `{twin}`, which has the same nodes in Python" if twin in names else ""
        )
        near = f"source Obelisk's C++ workspace{in_python};"
    return found(
        "OBK401",
        f"package `{package}` was not found",
        places[0],
        help=f"{near} {looked}" if near else looked,
        related=(Related(message="also named here", span=place) for place in places[1:]),
    )


def check_files(context: CheckContext) -> Iterator[Diagnostic]:
    """Check the files that are passed to nodes."""
    for node in context.stack.nodes:
        in_sims = (("config_path", file) for sim in node.used_sims for file in sim.files)
        for key, search in (("params_path", node.params_file), *in_sims):
            if search is not None and search.found is None:
                yield _no_file(key, search)
        urdf = node.urdf_file
        if urdf is not None and urdf.found is None:
            if urdf.missing_package is not None and node.robot_pkg is not None:
                yield no_such_package(urdf, node.robot_pkg, "description", context.environment)
            else:
                yield _no_file("urdf", urdf)


def check_manifests(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that the package.xml of every package in the config can be read."""
    named: dict[str, Span] = {}
    for node in context.stack.nodes:
        of_sims = (sim.robot_pkg for sim in node.used_sims)
        for package in (node.pkg, node.robot_pkg, *of_sims):
            if package is not None:
                named.setdefault(package.value, package.span)
    for name, span in named.items():
        fault = context.environment.manifest_fault(name)
        if fault is not None and fault.span is not None:
            yield found(
                "OBK414",
                f"package.xml of `{name}` {fault.message}",
                fault.span,
                help=fault.help,
                related=(Related(message="the config names the package", span=span),),
            )


def _no_file(key: str, search: FileSearch) -> Diagnostic:
    return found(
        "OBK404",
        f"file `{search.written.value}` of `{key}` does not exist",
        search.written.span,
        help=where_it_is_not(search),
    )
