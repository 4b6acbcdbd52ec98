"""What a whole package, or one node more in a package, consists of.

In: answers, templates, and for an addition the texts of the package's own files. Out: files in
memory. Never touches the disk.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import PurePosixPath

from obk_cli.scaffold.entry_points import PackageTexts, add_console_script
from obk_cli.scaffold.kinds import SERVICE_LAYER, recipe_of
from obk_cli.scaffold.names import Problem
from obk_cli.scaffold.package_xml import add_dependencies
from obk_cli.scaffold.questions import Answers
from obk_cli.scaffold.render import (
    NODE_VARIABLE,
    RenderedFile,
    Template,
    render_templates,
)
from obk_cli.scaffold.snippet import TOPICS_TO_FILL_IN
from obk_cli.scaffold.variables import dependencies, entry_point, template_variables

__all__ = ["Composition", "compose_addition", "compose_package", "layers_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Composition:
    """New files, and new versions of files that are there."""

    files: tuple[RenderedFile, ...]
    edits: tuple[RenderedFile, ...] = ()


def layers_of(answers: Answers) -> tuple[str, ...]:
    """The template folders that are to be read."""
    recipe = recipe_of(answers.kind, answers.language)
    assert recipe is not None, "the answers have been checked"
    return (*recipe.layers, SERVICE_LAYER) if answers.with_service else recipe.layers


def compose_package(
    answers: Answers,
    templates: Iterable[Template],
    *,
    topics: str = TOPICS_TO_FILL_IN,
) -> Composition:
    """A package of its own; `topics` is the name under which its topics are.

    Raises:
        TemplateFaultError: a template cannot be rendered.
    """
    return Composition(files=render_templates(templates, template_variables(answers, topics)))


def compose_addition(
    answers: Answers,
    templates: Iterable[Template],
    texts: PackageTexts,
    *,
    python_folder: str = ".",
) -> Composition | Problem:
    """One node more in the package of these texts; its modules are below `python_folder`.

    Raises:
        TemplateFaultError: a template cannot be rendered.
    """
    edits = add_console_script(texts, entry_point(answers))
    if isinstance(edits, Problem):
        return edits
    package_xml = add_dependencies(texts.package_xml, dependencies(answers))
    of_the_node = [template for template in templates if NODE_VARIABLE in template.name]
    files = render_templates(of_the_node, template_variables(answers))
    return Composition(
        files=tuple(_moved(file, answers.package, python_folder) for file in files),
        edits=(*(_edited(*edit) for edit in edits.items()), _edited("package.xml", package_xml)),
    )


def _moved(file: RenderedFile, package: str, python_folder: str) -> RenderedFile:
    is_module = file.path.parts[0] == package
    return replace(file, path=PurePosixPath(python_folder, file.path)) if is_module else file


def _edited(name: str, text: str) -> RenderedFile:
    return RenderedFile(path=PurePosixPath(name), content=text.encode())
