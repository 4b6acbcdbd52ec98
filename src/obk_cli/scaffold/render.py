"""Templates to files in memory.

In: templates and their variables. Out: relative paths with their bytes and modes. Never writes and
never reads; templates are data and run sandboxed. A template that never ends is stopped by whoever
calls: those of a user are rendered in a process of their own.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath

from jinja2 import StrictUndefined, TemplateError, TemplateSyntaxError
from jinja2.sandbox import ImmutableSandboxedEnvironment

from obk_cli.errors import CommandFailedError

__all__ = [
    "NODE_VARIABLE",
    "RenderedFile",
    "Renderer",
    "Template",
    "TemplateFaultError",
    "render_templates",
]

NODE_VARIABLE = "{{ node }}"
"""A template whose file name holds this belongs to one node, the others to the package."""

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


Renderer = Callable[[Iterable[Template], Mapping[str, object]], tuple[RenderedFile, ...]]
"""`render_templates`, or the same with bounds."""


def render_templates(
    templates: Iterable[Template], variables: Mapping[str, object]
) -> tuple[RenderedFile, ...]:
    """Render names and contents; only `.jinja` files are templates, others are copied.

    Raises:
        TemplateFaultError: a template does not parse, uses an unknown variable, does what the
            sandbox forbids, names a file outside the package, or one that another makes too.
    """
    environment = ImmutableSandboxedEnvironment(
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # the output is code, not HTML; every value is a checked name
    )
    files = tuple(_render_file(environment, template, variables) for template in templates)
    _refuse_doubles(files)
    return files


def _render_file(
    environment: ImmutableSandboxedEnvironment, template: Template, variables: Mapping[str, object]
) -> RenderedFile:
    try:
        name = environment.from_string(template.name.removesuffix(_SUFFIX)).render(variables)
        content = template.content
        if template.name.endswith(_SUFFIX):
            content = environment.from_string(content.decode()).render(variables).encode()
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
