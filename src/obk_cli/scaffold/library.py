"""Which templates there are: the tool's own, with a user's folder on top.

In: folders. Out: templates in memory. Reads only; never follows a symbolic link.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import CommandFailedError
from obk_cli.scaffold.kinds import LAYER_NAMES
from obk_cli.scaffold.render import Template

__all__ = ["Library", "open_library"]

_LONGEST_TEMPLATE_BYTES = 1024 * 1024
_MOST_TEMPLATES = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Library:
    """The folder of the tool's own templates, and the user's, if any."""

    own: Path
    user: Path | None = None

    def has_of_user(self, layers: Iterable[str]) -> bool:
        """Whether the user's folder has a say in these template folders."""
        return self.user is not None and any((self.user / layer).is_dir() for layer in layers)

    def read(self, layers: Iterable[str]) -> tuple[Template, ...]:
        """The templates of these folders, sorted; a later one of the same name wins.

        Raises:
            CommandFailedError: the user's folder holds what is no template.
        """
        found = {
            template.name.removesuffix(".jinja"): template
            for layer in layers
            for template in (*_read_own(self.own / layer), *self._read_user(layer))
        }
        return tuple(found[name] for name in sorted(found))

    def _read_user(self, layer: str) -> tuple[Template, ...]:
        if self.user is None or not (self.user / layer).exists():
            return ()
        templates = tuple(_read_checked(self.user / layer, self.user / layer))
        if len(templates) > _MOST_TEMPLATES:
            raise CommandFailedError(
                f"{self.user / layer} holds {len(templates)} files; "
                f"at most {_MOST_TEMPLATES} were expected"
            )
        return templates


def open_library(own: Path, user: Path | None) -> Library:
    """The library of the two folders.

    Raises:
        CommandFailedError: the user's is no folder, or holds a folder that no kind has.
    """
    if user is None:
        return Library(own=own)
    if not user.is_dir():
        raise CommandFailedError(f"the template folder {user} is not there")
    for folder in sorted(user.iterdir()):
        if folder.is_dir() and not folder.name.startswith(".") and folder.name not in LAYER_NAMES:
            near = did_you_mean(folder.name, LAYER_NAMES)
            raise CommandFailedError(
                f"{folder} is the template folder of nothing that `obk new` makes",
                help=near or "`obk new --list` shows the folders that there are",
            )
    return Library(own=own, user=user)


def _read_own(folder: Path) -> Iterator[Template]:
    for path in sorted(folder.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            name = path.relative_to(folder).as_posix()
            yield Template(name=name, content=path.read_bytes())


def _read_checked(folder: Path, place: Path) -> Iterator[Template]:
    """A user's templates: ordinary files of a sensible size, and nothing behind a link."""
    if place.is_symlink():
        raise CommandFailedError(f"{place} is a symbolic link; a template is an ordinary file")
    if place.is_dir():
        for path in sorted(place.iterdir()):
            if path.name != "__pycache__":
                yield from _read_checked(folder, path)
        return
    if not place.is_file():
        raise CommandFailedError(f"{place} is no ordinary file, as a template is")
    size = place.stat().st_size
    if size > _LONGEST_TEMPLATE_BYTES:
        raise CommandFailedError(
            f"{place} has {size} bytes; at most {_LONGEST_TEMPLATE_BYTES} were expected"
        )
    name = place.relative_to(folder).as_posix()
    yield Template(name=name, content=place.read_bytes(), folder=str(folder))
