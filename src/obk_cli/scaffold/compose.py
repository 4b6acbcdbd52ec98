"""Compose the files of a package, of another node in it, or of a workspace.

Pure: returns files in memory.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import Final

from obk_cli.install_source import InstallSource
from obk_cli.scaffold.kinds import (
    ARM_LAYER,
    HOLD_LAYER,
    LONGEST_NAME,
    MODEL_LAYER,
    NODE_KINDS,
    PACKAGE_OF_WORKSPACE_LAYERS,
    SERVICE_LAYER,
    SETTINGS_LAYER,
    WORKSPACE_LAYER,
    Kind,
    Problem,
    recipe_of,
)
from obk_cli.scaffold.package_files import PackageTexts, add_console_script, add_dependencies
from obk_cli.scaffold.package_spec import PackageRequest, PackageSpec, check_request
from obk_cli.scaffold.robot_model import RobotModel, model_variables
from obk_cli.scaffold.templates import (
    NODE_VARIABLE,
    RenderedFile,
    Template,
    TemplateLibrary,
    render_templates,
)
from obk_cli.scaffold.variables import (
    TestedStack,
    dependencies,
    entry_point,
    template_variables,
)

__all__ = [
    "Composition",
    "check_stack",
    "compose_addition",
    "compose_package",
    "compose_workspace",
    "layers_of",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Composition:
    """New files, and new versions of existing files."""

    files: tuple[RenderedFile, ...]
    edits: tuple[RenderedFile, ...] = ()


def layers_of(spec: PackageSpec, *, has_settings: bool = True) -> tuple[str, ...]:
    """The template folders to read.

    `has_settings`: whether a folder above the package has settings for tests and linters.
    """
    recipe = recipe_of(spec.kind, spec.language)
    assert recipe is not None, "the spec was checked"
    service = (SERVICE_LAYER,) if spec.with_service else ()
    is_python = spec.kind in NODE_KINDS and spec.language == "py"
    settings = (SETTINGS_LAYER,) if is_python and not has_settings else ()
    return (*recipe.layers, *service, *settings)


def compose_package(
    spec: PackageSpec,
    templates: Iterable[Template],
    *,
    stack: TestedStack | None = None,
) -> Composition:
    """Compose a new package.

    Args:
        spec: the package.
        templates: templates of its layers.
        stack: the stack that its node joins, and that its test runs.

    Raises:
        TemplateFaultError: a template cannot be rendered.
    """
    return Composition(files=render_templates(templates, template_variables(spec, stack=stack)))


def compose_addition(
    spec: PackageSpec,
    templates: Iterable[Template],
    texts: PackageTexts,
    *,
    python_folder: str = ".",
    stack: TestedStack | None = None,
) -> Composition | Problem:
    """Compose another node in an existing package.

    Args:
        spec: the node.
        templates: templates of a package's layers.
        texts: files of the package.
        python_folder: folder of its modules.
        stack: the stack that the node joins, and that its test runs.

    Raises:
        TemplateFaultError: a template cannot be rendered.
    """
    edits = add_console_script(texts, entry_point(spec))
    if isinstance(edits, Problem):
        return edits
    package_xml = add_dependencies(texts.package_xml, dependencies(spec))
    of_the_node = [template for template in templates if NODE_VARIABLE in template.name]
    files = render_templates(of_the_node, template_variables(spec, stack=stack))
    return Composition(
        files=tuple(_moved(file, spec.package, python_folder) for file in files),
        edits=(*(_edited(*edit) for edit in edits.items()), _edited("package.xml", package_xml)),
    )


def _moved(file: RenderedFile, package: str, python_folder: str) -> RenderedFile:
    is_module = file.path.parts[0] == package
    return replace(file, path=PurePosixPath(python_folder, file.path)) if is_module else file


def _edited(name: str, text: str) -> RenderedFile:
    return RenderedFile(path=PurePosixPath(name), content=text.encode())


_KINDS: Final[tuple[Kind, ...]] = ("controller", "estimator")

LONGEST_STACK_NAME: Final = LONGEST_NAME - len("_controller")
"""Keeps the names of packages within their limit [characters]."""


def check_stack(
    stack: str, *, owner_of: Callable[[str], str | None], is_torque: bool = False
) -> tuple[PackageSpec, ...] | Problem:
    """The two packages of a stack with this (checked) name, or why they cannot be created.

    `is_torque`: the controller sends gains to the joints' actuators.
    """
    if len(stack) > LONGEST_STACK_NAME:
        return Problem(
            sentence=f"the name `{stack}` has {len(stack)} characters; "
            f"expected at most {LONGEST_STACK_NAME}",
            help="choose a shorter name, because packages are named after it",
        )
    found: list[PackageSpec] = []
    for kind in _KINDS:
        request = PackageRequest(
            kind=kind,
            name=f"{stack}_{kind}",
            ctrl_msg="PDFeedForward" if is_torque else None,
            sensor_msg="ObkJointEncoders",
        )
        spec = check_request(request, owner_of=owner_of)
        if not isinstance(spec, PackageSpec):
            return spec[0]
        found.append(spec)
    return tuple(found)


def compose_workspace(
    stack: str,
    packages: tuple[PackageSpec, ...],
    library: TemplateLibrary,
    source: InstallSource,
    robot: RobotModel | None = None,
) -> tuple[RenderedFile, ...]:
    """Return all files, with their paths in the workspace.

    Args:
        stack: name of the stack.
        packages: packages of the workspace's nodes.
        library: the templates.
        source: where the workspace's CI installs obk from.
        robot: the model of the stack; None: create an arm.

    Raises:
        TemplateFaultError: a template cannot be rendered.
    """
    of_model = model_variables(robot) if robot else {}
    variables = {
        "stack": stack,
        "install": source.pip_install("ros", "sim", "test"),
        "is_local_source": source.is_local,
        **of_model,
    }
    layers = [WORKSPACE_LAYER, SETTINGS_LAYER, MODEL_LAYER if robot else ARM_LAYER]
    files = [*render_templates(library.read(layers), variables)]
    for spec in packages:
        over = (HOLD_LAYER,) if robot and spec.kind == "controller" else ()
        templates = library.read((*PACKAGE_OF_WORKSPACE_LAYERS[spec.kind], *over))
        values = template_variables(spec, f"/{stack}") | of_model
        folder = PurePosixPath("src", spec.package)
        files += [
            RenderedFile(path=folder / file.path, content=file.content)
            for file in render_templates(templates, values)
        ]
    return tuple(files)
