"""Find the templates of `obk new`, and print what they can make (`obk new --list`).

A user's own templates are in `--templates`, otherwise in OBK_TEMPLATES, otherwise in the user's
config folder.
"""

import json
import os
from pathlib import Path
from typing import Literal

from obk_cli.errors import CommandFailedError
from obk_cli.files import resource_folder
from obk_cli.scaffold.kinds import RECIPES, Recipe
from obk_cli.scaffold.templates import Library, open_library

__all__ = ["find_library", "print_kinds"]


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


def print_kinds(templates: Path | None, form: Literal["text", "json"]) -> None:
    """Print a line for each kind and language.

    Raises:
        CommandFailedError: the user's templates cannot be read.
    """
    library = find_library(templates)
    if form == "json":
        print(json.dumps([_as_json(recipe, library) for recipe in RECIPES], indent=2))
        return
    for recipe in RECIPES:
        print(f"{recipe.kind:<11} {recipe.language or '-':<4} {recipe.summary}")
        for layer, places in _places(recipe, library).items():
            print(f"{'':<17}{layer} ({', '.join(places)})")


def _places(recipe: Recipe, library: Library) -> dict[str, list[str]]:
    """The template folders, each with where its files are from."""
    places: dict[str, list[str]] = {}
    for layer in recipe.layers:
        places[layer] = ["obk"]
        if library.user is not None and library.has_of_user([layer]):
            places[layer].append(str(library.user / layer))
    return places


def _as_json(recipe: Recipe, library: Library) -> dict[str, object]:
    return {
        "kind": recipe.kind,
        "language": recipe.language,
        "summary": recipe.summary,
        "templates": _places(recipe, library),
    }
