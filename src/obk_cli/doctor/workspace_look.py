"""The workspace around the working folder: its packages, and which message packages want a build.

In: a folder. Out: facts. Builds and writes nothing.
"""

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from obk_cli.doctor.workspace import WorkspaceFacts
from obk_cli.workspace.message_build import survey_of
from obk_cli.workspace.package_index import find_workspace, package_folders
from obk_interfaces import InterfaceError

__all__ = ["look_at_workspace"]

_NAME: Final = re.compile(r"<name>\s*([^<\s]+)\s*</name>")


def look_at_workspace(working_folder: Path, environment: Mapping[str, str]) -> WorkspaceFacts:
    """Look through the sources of the workspace that a folder is in."""
    workspace = find_workspace(working_folder)
    manifests = [folder / "package.xml" for folder in package_folders(workspace)]
    if not manifests:
        return WorkspaceFacts(folder=None, packages=(), broken=(), doubled=(), unbuilt=())
    names = {path: _NAME.search(path.read_text(errors="replace")) for path in manifests}
    told = Counter(found[1] for found in names.values() if found)
    unbuilt: tuple[str, ...] = ()
    fault = ""
    try:
        unbuilt = tuple(one.name for one in survey_of(workspace, environment).stale)
    except InterfaceError as error:
        fault = str(error)
    return WorkspaceFacts(
        folder=str(workspace),
        packages=tuple(sorted(told)),
        broken=tuple(str(path) for path, found in names.items() if not found),
        doubled=tuple(sorted(name for name, count in told.items() if count > 1)),
        unbuilt=unbuilt,
        fault=fault,
    )
