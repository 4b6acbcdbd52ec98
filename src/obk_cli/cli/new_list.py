"""`obk new --list`: what can be made, in which languages, and from which folders."""

import json
from pathlib import Path
from typing import Literal

from obk_cli.cli.template_folder import find_library
from obk_cli.scaffold.kinds import RECIPES, Recipe
from obk_cli.scaffold.templates import Library

__all__ = ["print_kinds"]


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
