"""Templates to files in memory.

In: folders of jinja templates and the answers. Out: relative paths with their bytes and modes.
Never writes; the only thing it reads is the templates, which are data and run sandboxed.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from jinja2 import StrictUndefined, TemplateError, TemplateSyntaxError
from jinja2.sandbox import SandboxedEnvironment

from obk_cli.errors import CommandFailedError
from obk_cli.scaffold.fields import control_filling, estimate_filling
from obk_cli.scaffold.imports import LINE_LENGTH, import_block, message_imports
from obk_cli.scaffold.questions import Answers
from obk_cli.scaffold.snippet import config_snippet

__all__ = [
    "NODE_VARIABLE",
    "RenderedFile",
    "Template",
    "TemplateFaultError",
    "dependencies",
    "entry_point",
    "read_templates",
    "render_templates",
    "template_variables",
]

NODE_VARIABLE = "{{ node }}"
"""A template whose file name holds this belongs to one node, the others to the package."""

_SUFFIX = ".jinja"
_BASES = {
    "controller": ("obelisk_py.core.control", "ObeliskController"),
    "estimator": ("obelisk_py.core.estimation", "ObeliskEstimator"),
}


class TemplateFaultError(CommandFailedError):
    """A template that cannot be rendered; the text names the file, the line and the reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """One file of a template folder; `name` is its path in the folder, with `/`."""

    name: str
    content: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderedFile:
    """One file to be made; `path` is relative to the package's folder."""

    path: PurePosixPath
    content: bytes

    @property
    def mode(self) -> int:
        """Permission bits: scripts are executable."""
        return 0o755 if self.content.startswith(b"#!") else 0o644


def read_templates(folders: Iterable[Path]) -> tuple[Template, ...]:
    """The files of the folders, sorted; a later folder's file replaces an earlier one's."""
    found = {
        path.relative_to(folder).as_posix(): path
        for folder in folders
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "__pycache__" not in path.parts
    }
    return tuple(Template(name=name, content=found[name].read_bytes()) for name in sorted(found))


def render_templates(
    templates: Iterable[Template], variables: Mapping[str, object]
) -> tuple[RenderedFile, ...]:
    """Render names and contents; only `.jinja` files are templates, others are copied.

    Raises:
        TemplateFaultError: a template does not parse, uses an unknown variable, does what the
            sandbox forbids, or names a file outside the package.
    """
    environment = SandboxedEnvironment(
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # the output is code, not HTML; every value is a checked name
    )
    return tuple(_render_file(environment, template, variables) for template in templates)


def template_variables(answers: Answers) -> dict[str, object]:
    """All that a template may use."""
    control = control_filling(answers.ctrl)
    estimate = estimate_filling(answers.est, answers.sensor)
    messages = message_imports(answers.messages)
    ros_lifecycle = "rclpy.lifecycle"
    node_imports = (
        *messages,
        _BASES[answers.kind],
        ("obelisk_py.core.utils.ros", "spin_obelisk"),
        (ros_lifecycle, "LifecycleState"),
        (ros_lifecycle, "TransitionCallbackReturn"),
    )
    test_imports = (*messages, (ros_lifecycle, "TransitionCallbackReturn"))
    own = (f"{answers.package}.{answers.node}", answers.class_name)
    return {
        "kind": answers.kind,
        "package": answers.package,
        "node": answers.node,
        "class_name": answers.class_name,
        "description": f"The Obelisk {answers.kind} {answers.node}.",
        "entry_point": entry_point(answers),
        "entry_point_noqa": _noqa(entry_point(answers)),
        "config_snippet": config_snippet(answers),
        "ctrl": answers.ctrl,
        "est": answers.est,
        "sensor": answers.sensor,
        "control": control,
        "estimate": estimate,
        "dependencies": dependencies(answers),
        "node_imports": import_block(node_imports),
        "test_imports": "import pytest\nimport rclpy\n"
        f"{import_block(test_imports)}\n\n{import_block([own])}",
    }


def dependencies(answers: Answers) -> tuple[str, ...]:
    """The ROS packages that the node needs, sorted."""
    return tuple(sorted({"rclpy", *(message.package for message in answers.messages)}))


def entry_point(answers: Answers) -> str:
    """The console script that runs the node."""
    return f"{answers.node} = {answers.package}.{answers.node}:main"


def _noqa(script: str) -> str:
    """A string in setup.py cannot be wrapped: long names leave the line too long."""
    indent_and_quotes = 15
    return "  # noqa: E501" if len(script) + indent_and_quotes > LINE_LENGTH else ""


def _render_file(
    environment: SandboxedEnvironment, template: Template, variables: Mapping[str, object]
) -> RenderedFile:
    try:
        name = environment.from_string(template.name.removesuffix(_SUFFIX)).render(variables)
        content = template.content
        if template.name.endswith(_SUFFIX):
            content = environment.from_string(content.decode()).render(variables).encode()
    except TemplateSyntaxError as fault:
        raise TemplateFaultError(f"{template.name}:{fault.lineno}: {fault.message}") from fault
    except (TemplateError, UnicodeDecodeError) as fault:
        raise TemplateFaultError(f"{template.name}: {fault}") from fault
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or not path.parts:
        raise TemplateFaultError(f"{template.name}: it would make `{name}`, outside the package")
    return RenderedFile(path=path, content=content)
