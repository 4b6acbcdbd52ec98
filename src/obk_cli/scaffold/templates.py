"""Find templates, the tool's own and the user's, and render them in jinja2's sandbox.

A template cannot reach Python objects beyond its variables; its loops over `range`, its powers and
repetitions, and the output are bounded. Symbolic links are not followed.

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
"""A template whose file name holds this belongs to one node, the others to the package."""

_MAX_OUTPUT_BYTES: Final = 32 * 1024 * 1024
"""For all files of one call together."""
_MAX_POWER_BITS: Final = 4096
_SUFFIX = ".jinja"
_FAULTS = (TemplateError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
"""What jinja and the filters that a template calls raise."""
_FORBIDDEN_PARTS = frozenset({"..", ".git"})
"""Of paths: what leads out of the folder, and what git would run."""


class TemplateFaultError(CommandFailedError):
    """A template that cannot be rendered; the text names the file, the line and the reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """One file of a template folder; `name` is its path in the folder, with `/`."""

    name: str
    content: bytes
    folder: str = ""
    """The user's folder that it is from; empty for the tool's own."""

    @property
    def shown(self) -> str:
        """How an error names it."""
        return f"{self.folder}/{self.name}" if self.folder else self.name


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderedFile:
    """One file to be made; `path` is relative to the package's folder."""

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
            sandbox forbids, exceeds its bounds, names a file outside the package, or one that
            another makes too.
    """
    sandbox = _Sandbox()
    files = tuple(_render_file(sandbox, template, variables) for template in templates)
    _refuse_doubles(files)
    return files


class _Sandbox(ImmutableSandboxedEnvironment):
    """The sandbox of one call; its bounds hold for all templates together.

    What exceeds a bound raises OverflowError, as jinja2's own `range` does.
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
        # jinja2 bounds each `range`; nested ones would still loop for hours.
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
        """The text that a template makes."""
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
        raise TemplateFaultError(f"{template.shown}: it asks for too much") from fault
    except _FAULTS as fault:
        raise TemplateFaultError(f"{template.shown}: {fault}") from fault
    return RenderedFile(path=_checked_path(name, template), content=content)


def _checked_path(name: str, template: Template) -> PurePosixPath:
    path = PurePosixPath(name)
    is_outside = path.is_absolute() or not path.parts or _FORBIDDEN_PARTS & set(path.parts)
    if is_outside or "\\" in name or not name.isprintable():
        raise TemplateFaultError(f"{template.shown}: it would make `{name}`, outside the package")
    return path


def _refuse_doubles(files: Iterable[RenderedFile]) -> None:
    """Of two files of one path, one would be lost; nor can a path be file and folder."""
    counts = Counter(file.path for file in files)
    for path, count in counts.items():
        if count > 1:
            raise TemplateFaultError(f"two templates would make `{path}`")
        folder = next((parent for parent in path.parents if parent in counts), None)
        if folder is not None:
            raise TemplateFaultError(f"`{folder}` would be a file and the folder of `{path}`")


_LONGEST_TEMPLATE_BYTES = 1024 * 1024
_MOST_TEMPLATES = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class TemplateLibrary:
    """The folder of the tool's own templates, and the user's, if any."""

    own: Path
    user: Path | None = None

    def has_of_user(self, layers: Iterable[str]) -> bool:
        """Whether the user's folder overrides one of these template folders."""
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


def open_library(own: Path, user: Path | None) -> TemplateLibrary:
    """The library of the two folders.

    Raises:
        CommandFailedError: the user's is no folder, or holds a folder that no kind has.
    """
    if user is None:
        return TemplateLibrary(own=own)
    if not user.is_dir():
        raise CommandFailedError(f"the template folder {user} is not there")
    for folder in sorted(user.iterdir()):
        if folder.is_dir() and not folder.name.startswith(".") and folder.name not in LAYER_NAMES:
            near = did_you_mean(folder.name, LAYER_NAMES)
            raise CommandFailedError(
                f"{folder} is the template folder of nothing that `obk new` makes",
                help=near or "`obk new --list` shows the folders that there are",
            )
    return TemplateLibrary(own=own, user=user)


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
