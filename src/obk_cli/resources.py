"""Where the data that comes with the tool lies: the schema, the templates.

A checkout has them at its root, an installed wheel under `obk_cli/data/`. Never reads them.
"""

from pathlib import Path

__all__ = ["resource_folder"]


def resource_folder(name: str) -> Path:
    """The folder of that name ("schema", "templates") that belongs to this very code.

    Raises:
        FileNotFoundError: it is in neither place; the installation is broken.
    """
    package = Path(__file__).resolve().parent
    places = (package / "data" / name, package.parents[1] / name)
    found = next((place for place in places if place.is_dir()), None)
    if found is None:
        tried = ", ".join(str(place) for place in places)
        raise FileNotFoundError(f"the tool's own folder `{name}` is missing; tried {tried}")
    return found
