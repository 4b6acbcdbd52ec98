"""OBK401, OBK402, OBK404: packages, executables and files that the config names."""

from collections import defaultdict
from collections.abc import Iterator

from obelisk_spec.names import package_name_fault
from obelisk_spec.near import did_you_mean, near_names
from obk_cli.config import FileSearch, Spanned, Stack
from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.surroundings import ExecutableMissing, Surroundings

__all__ = ["check_executables", "check_files"]


def check_executables(stack: Stack, surroundings: Surroundings) -> Iterator[Diagnostic]:
    """Every node's package and executable are there; a missing package is told once."""
    missing: dict[str, list[Spanned[str]]] = defaultdict(list)
    searched: tuple[str, ...] = ()
    for node in stack.nodes:
        if node.pkg is None or node.executable is None or package_name_fault(node.pkg.value):
            continue
        answer = surroundings.find_executable(node.pkg.value, node.executable.value)
        if not isinstance(answer, ExecutableMissing):
            continue
        if answer.package_found:
            yield _no_executable(answer, node.executable)
        else:
            missing[node.pkg.value].append(node.pkg)
            searched = answer.searched
    for package, places in missing.items():
        yield _no_package(package, places, searched, surroundings)


def _no_executable(answer: ExecutableMissing, executable: Spanned[str]) -> Diagnostic:
    return found(
        "OBK402",
        f"package `{answer.package}` has no executable `{answer.executable}`",
        executable.span,
        help=did_you_mean(answer.executable, answer.available) or "it has none at all",
    )


def _no_package(
    package: str,
    places: list[Spanned[str]],
    searched: tuple[str, ...],
    surroundings: Surroundings,
) -> Diagnostic:
    # Message packages have no executables, and their names are near those of everything.
    names = [name for name in surroundings.package_names() if not name.endswith("_msgs")]
    near = did_you_mean(package, names) if near_names(package, names) else None
    looked = f"searched {', '.join(searched)}"
    return found(
        "OBK401",
        f"package `{package}` is not found",
        places[0].span,
        help=f"{near} {looked}" if near else looked,
        related=(Related(message="named here too", span=place.span) for place in places[1:]),
    )


def check_files(stack: Stack, _: Surroundings) -> Iterator[Diagnostic]:
    """Files that are handed to nodes."""
    for node in stack.nodes:
        in_sims = (("config_path", file) for sim in node.sims for file in sim.files)
        own = (("params_path", node.params_file), ("urdf", node.urdf_file))
        for key, search in (*own, *in_sims):
            if search is not None and search.found is None:
                yield _no_file(key, search)


def _no_file(key: str, search: FileSearch) -> Diagnostic:
    return found(
        "OBK404",
        f"file `{search.written.value}` of `{key}` is not there",
        search.written.span,
        help=f"tried {', '.join(str(path) for path in search.tried)}",
    )
