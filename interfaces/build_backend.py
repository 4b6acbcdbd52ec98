"""Build backend of obelisk-interfaces: hatchling, with the message generator of the same version.

In a checkout, the generator `obk_interfaces` is in `../src`. A source distribution does not
contain it and is built with the released generator.
"""

import sys
import tomllib
from pathlib import Path
from typing import Any

from hatchling import build as hatchling
from hatchling.build import build_sdist, build_wheel, get_requires_for_build_sdist

__all__ = [
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
]

FOLDER = Path(__file__).resolve().parent
SOURCES = FOLDER.parent / "src"
IS_CHECKOUT = (SOURCES / "obk_interfaces").is_dir()

if IS_CHECKOUT:
    sys.path.insert(0, str(SOURCES))


def get_requires_for_build_wheel(config_settings: dict[str, Any] | None = None) -> list[str]:
    """Return what the build needs besides the requirements in pyproject.toml."""
    project = tomllib.loads((FOLDER / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    generator = [] if IS_CHECKOUT else [f"obelisk-cli=={project['version']}"]
    return [*hatchling.get_requires_for_build_wheel(config_settings), *generator]
