"""Where a user's own templates are: `--templates`, else OBK_TEMPLATES, else the config folder."""

import os
from pathlib import Path

from obk_cli.errors import CommandFailedError
from obk_cli.resources import resource_folder
from obk_cli.scaffold.templates import Library, open_library

__all__ = ["find_library"]


def find_library(chosen: Path | None) -> Library:
    """The tool's own templates with the user's on top.

    Raises:
        CommandFailedError: the user's folder is not there, or holds what no kind has.
    """
    try:
        return open_library(resource_folder("templates"), chosen or _usual_folder())
    except OSError as fault:
        raise CommandFailedError(f"the templates cannot be read: {fault}") from fault


def _usual_folder() -> Path | None:
    named = os.environ.get("OBK_TEMPLATES")
    if named:
        return Path(named)
    from platformdirs import user_config_path  # only where nothing else says

    folder = user_config_path("obk") / "templates"
    return folder if folder.is_dir() else None
