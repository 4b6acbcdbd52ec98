"""Find the built-in and the user's templates, and render them in jinja2's sandbox.

A template has no access to Python objects except its variables. Loops over `range`, powers,
repetitions and the output are limited. Symbolic links are not followed.

Source: https://jinja.palletsprojects.com/en/stable/sandbox/
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sized
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

from jinja2 import StrictUndefined, TemplateError, TemplateSyntaxError
from jinja2.runtime import Context
from jinja2.sandbox import MAX_RANGE, ImmutableSandboxedEnvironment

from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import CommandFailedError
from obk_cli.scaffold.kinds import LAYER_NAMES

__all__ = [
    "NODE_VARIABLE",
    "RenderedFile",
    "Template",
    "TemplateFaultError",
    "TemplateLibrary",
    "open_library",
    "render_templates",
]

NODE_VARIABLE = "{{ node }}"
"""A template with this in its file name belongs to one node, any other to the package."""

_MAX_OUTPUT_BYTES: Final = 32 * 1024 * 1024
"""Total limit for all files of one call."""
_MAX_POWER_BITS: Final = 4096
_SUFFIX = ".jinja"
_FAULTS = (TemplateError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
"""Exceptions of jinja and of the filters that a template calls."""
_FORBIDDEN_PARTS = frozenset({"..", ".git"})
"""Forbidden in paths: what leads out of the folder, and what git would run."""


class TemplateFaultError(CommandFailedError):
    """A template that cannot be rendered; the message names the file, line and reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """A file of a template folder; `name` is its path in the folder, with `/`."""

    name: str
    content: bytes
    folder: str = ""
    """The user's folder from which it comes; empty for built-in ones."""

    @property
    def shown(self) -> str:
        """The name in error messages."""
        return f"{self.folder}/{self.name}" if self.folder else self.name


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderedFile:
    """A file to create; `path` is relative to the package's folder."""

    path: PurePosixPath
    content: bytes

    @property
    def mode(self) -> int:
        """Permission bits: scripts are executable."""
        return 0o755 if self.content.startswith(b"#!") else 0o644


def render_templates(
    templates: Iterable[Template], variables: Mapping[str, object]
) -> tuple[RenderedFile, ...]:
    """Render names and contents; only `.jinja` files are templates, others are copied.

    Raises:
        TemplateFaultError: a template does not parse, uses an unknown variable, does what the
            sandbox forbids, exceeds its limits, names a file outside the package, or names the same
            file as another template.
    """
    sandbox = _Sandbox()
    files = tuple(_render_file(sandbox, template, variables) for template in templates)
    _refuse_doubles(files)
    return files


class _Sandbox(ImmutableSandboxedEnvironment):
    """The sandbox of one call; its limits apply to the total of all templates.

    Exceeding a limit raises OverflowError, as in jinja2's own `range`.
    """

    intercepted_binops = frozenset({"*", "**"})

    def __init__(self) -> None:
        super().__init__(
            undefined=StrictUndefined,
            keep_trailing_newline=True,
            trim_blocks=True,
            lstrip_blocks=True,
            autoescape=False,  # the output is code, not HTML; every value is a checked name
        )
        # jinja2 limits each `range`, but nested ones could still loop for hours.
        self.globals["range"] = self._range
        self._steps_left = MAX_RANGE
        self._bytes_left = _MAX_OUTPUT_BYTES

    def call_binop(self, context: Context, operator: str, left: Any, right: Any) -> Any:
        """Python's `*` and `**`, unless the result would be too large."""
        if operator == "**":
            self._check_power(left, right)
        else:
            self._check_repetition(left, right)
            self._check_repetition(right, left)
        return super().call_binop(context, operator, left, right)

    def render(self, text: str, variables: Mapping[str, object]) -> str:
        """Render a template's text."""
        parts = []
        for part in self.from_string(text).generate(variables):
            self._bytes_left -= len(part)
            if self._bytes_left < 0:
                raise OverflowError
            parts.append(part)
        return "".join(parts)

    def _range(self, *arguments: int) -> range:
        numbers = range(*arguments)
        self._steps_left -= len(numbers)
        if self._steps_left < 0:
            raise OverflowError
        return numbers

    def _check_power(self, base: object, exponent: object) -> None:
        if not isinstance(base, int) or not isinstance(exponent, int):
            return
        if base.bit_length() * exponent > _MAX_POWER_BITS:
            raise OverflowError

    def _check_repetition(self, items: object, count: object) -> None:
        if not isinstance(items, Sized) or not isinstance(count, int):
            return
        if len(items) * count > _MAX_OUTPUT_BYTES:
            raise OverflowError


def _render_file(
    sandbox: _Sandbox, template: Template, variables: Mapping[str, object]
) -> RenderedFile:
    try:
        name = sandbox.render(template.name.removesuffix(_SUFFIX), variables)
        content = template.content
        if template.name.endswith(_SUFFIX):
            content = sandbox.render(content.decode(), variables).encode()
    except TemplateSyntaxError as fault:
        raise TemplateFaultError(f"{template.shown}:{fault.lineno}: {fault.message}") from fault
    except (OverflowError, MemoryError, RecursionError) as fault:
        raise TemplateFaultError(f"{template.shown}: it exceeds a limit") from fault
    except _FAULTS as fault:
        raise TemplateFaultError(f"{template.shown}: {fault}") from fault
    return RenderedFile(path=_checked_path(name, template), content=content)


def _checked_path(name: str, template: Template) -> PurePosixPath:
    path = PurePosixPath(name)
    is_outside = path.is_absolute() or not path.parts or _FORBIDDEN_PARTS & set(path.parts)
    if is_outside or "\\" in name or not name.isprintable():
        raise TemplateFaultError(f"{template.shown}: it would create `{name}` outside the package")
    return path


def _refuse_doubles(files: Iterable[RenderedFile]) -> None:
    """Reject two files with the same path, and a path that is both file and folder."""
    counts = Counter(file.path for file in files)
    for path, count in counts.items():
        if count > 1:
            raise TemplateFaultError(f"two templates would create `{path}`")
        folder = next((parent for parent in path.parents if parent in counts), None)
        if folder is not None:
            raise TemplateFaultError(f"`{folder}` would be both a file and the folder of `{path}`")


_LONGEST_TEMPLATE_BYTES = 1024 * 1024
_MOST_TEMPLATES = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class TemplateLibrary:
    """The built-in template folder, and the user's, if any."""

    own: Path
    user: Path | None = None

    def has_of_user(self, layers: Iterable[str]) -> bool:
        """Whether the user's folder overrides one of these template folders."""
        return self.user is not None and any((self.user / layer).is_dir() for layer in layers)

    def read(self, layers: Iterable[str]) -> tuple[Template, ...]:
        """The templates of these folders, sorted; a later one overrides the same name.

        Raises:
            CommandFailedError: the user's folder contains an invalid template.
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
                f"{self.user / layer} contains {len(templates)} files; "
                f"expected at most {_MOST_TEMPLATES}"
            )
        return templates


def open_library(own: Path, user: Path | None) -> TemplateLibrary:
    """Open the library with these two folders.

    Raises:
        CommandFailedError: the user's folder does not exist, or contains an unknown folder.
    """
    if user is None:
        return TemplateLibrary(own=own)
    if not user.is_dir():
        raise CommandFailedError(f"the template folder {user} does not exist")
    for folder in sorted(user.iterdir()):
        if folder.is_dir() and not folder.name.startswith(".") and folder.name not in LAYER_NAMES:
            near = did_you_mean(folder.name, LAYER_NAMES)
            raise CommandFailedError(
                f"{folder} does not match any template folder of `obk new`",
                help=near or "list the template folders with `obk new --list`",
            )
    return TemplateLibrary(own=own, user=user)


def _read_own(folder: Path) -> Iterator[Template]:
    for path in sorted(folder.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            name = path.relative_to(folder).as_posix()
            yield Template(name=name, content=path.read_bytes())


def _read_checked(folder: Path, place: Path) -> Iterator[Template]:
    """A user's templates: regular files within the size limit, not behind a link."""
    if place.is_symlink():
        raise CommandFailedError(f"{place} is a symbolic link, expected a regular file")
    if place.is_dir():
        for path in sorted(place.iterdir()):
            if path.name != "__pycache__":
                yield from _read_checked(folder, path)
        return
    if not place.is_file():
        raise CommandFailedError(f"{place} is not a regular file")
    size = place.stat().st_size
    if size > _LONGEST_TEMPLATE_BYTES:
        raise CommandFailedError(
            f"{place} has {size} bytes; expected at most {_LONGEST_TEMPLATE_BYTES}"
        )
    name = place.relative_to(folder).as_posix()
    yield Template(name=name, content=place.read_bytes(), folder=str(folder))
