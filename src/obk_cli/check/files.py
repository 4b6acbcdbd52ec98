"""What is said of a file that is not where a config looks for it."""

from obelisk_spec.near import ask_for
from obk_cli.config import FileSearch

__all__ = ["where_it_is_not"]


def where_it_is_not(search: FileSearch) -> str:
    """A help line: files that may be meant, and the places that were tried."""
    tried = f"tried {', '.join(str(path) for path in search.tried)}"
    near = ask_for(search.near)
    return f"{near} {tried}" if near else tried
