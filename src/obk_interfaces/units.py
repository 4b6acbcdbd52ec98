"""Gathers the sources of a library into few translation units.

Generated sources are many and small and include the same large headers: one unit for all those of
a library and language compiles three times as fast as one each.
"""

import hashlib
from pathlib import Path

from obk_interfaces.libraries import Library

__all__ = ["object_of", "write_units"]

# Sources of this ending define file-local names that clash with each other's.
_ALONE = "__description.c"
# Two of the generated sources' own macros are defined in each file.
_SEPARATOR = "#undef STRINGIFY\n#undef STRINGIFY_\n"


def write_units(library: Library, folder: Path) -> tuple[Path, ...]:
    """Write the unity sources of a library into a folder; return everything to be compiled."""
    alone = [source for source in library.sources if source.name.endswith(_ALONE)]
    together = [source for source in library.sources if not source.name.endswith(_ALONE)]
    units = [*alone]
    for suffix in sorted({source.suffix for source in together}):
        unit = folder / f"{Path(library.file).stem}.unity{suffix}"
        members = (source for source in together if source.suffix == suffix)
        text = _SEPARATOR.join(f'#include "{member}"\n' for member in members)
        unit.write_text(text, encoding="utf-8")
        units.append(unit)
    return tuple(units)


def object_of(library: Library, unit: Path, folder: Path) -> Path:
    """Return the object file of a unit; the digest keeps equal file names apart."""
    digest = hashlib.sha256(str(unit).encode()).hexdigest()[:8]
    return folder / f"{Path(library.file).stem}.{digest}.o"
