"""What is said of a file that is not where a config looks for it."""

from obelisk_spec.suggestions import ask_for, near_names
from obk_cli.config import FileSearch, Spanned
from obk_cli.diagnostics import Diagnostic, found
from obk_cli.surroundings import Surroundings

__all__ = ["no_such_package", "where_it_is_not"]


def where_it_is_not(search: FileSearch) -> str:
    """A help line: files that may be meant, and the places that were tried."""
    tried = f"tried {', '.join(str(path) for path in search.tried)}"
    near = ask_for(search.near)
    if search.written.value.startswith("~/"):
        near = f"`~` is not expanded, write `${{HOME}}{search.written.value[1:]}`;"
    return f"{near} {tried}" if near else tried


def no_such_package(
    search: FileSearch, package: Spanned[str], what: str, surroundings: Surroundings
) -> Diagnostic:
    """A finding about the `robot_pkg` that was to hold a file; `what` the file is."""
    near = ask_for(near_names(package.value, surroundings.package_names()))
    return found(
        "OBK403",
        f"package `{package.value}` of the {what} `{search.written.value}` is not found",
        package.span,
        help=near or where_it_is_not(search),
    )
