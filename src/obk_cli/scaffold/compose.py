"""What a whole package, or one node more in a package, consists of.

In: answers, templates, and for an addition the texts of the package's own files. Out: files in
memory. Never touches the disk.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import PurePosixPath

from obk_cli.scaffold.names import Problem
from obk_cli.scaffold.package_xml import add_dependencies
from obk_cli.scaffold.questions import Answers, Kind
from obk_cli.scaffold.render import (
    NODE_VARIABLE,
    RenderedFile,
    Template,
    dependencies,
    entry_point,
    render_templates,
    template_variables,
)
from obk_cli.scaffold.setup_py import add_entry_point

__all__ = ["LAYERS", "Composition", "PackageTexts", "compose_addition", "compose_package"]

LAYERS: dict[Kind, tuple[str, ...]] = {
    "controller": ("package_py", "controller"),
    "estimator": ("package_py", "estimator"),
}
"""The template folders that a kind of package is made of; a later one wins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageTexts:
    """The two files of an existing package that a new node changes."""

    package_xml: str
    setup_py: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Composition:
    """New files, and new versions of files that are there."""

    files: tuple[RenderedFile, ...]
    edits: tuple[RenderedFile, ...] = ()


def compose_package(answers: Answers, templates: Iterable[Template]) -> Composition:
    """A package of its own.

    Raises:
        TemplateFaultError: a template cannot be rendered.
    """
    return Composition(files=render_templates(templates, template_variables(answers)))


def compose_addition(
    answers: Answers, templates: Iterable[Template], texts: PackageTexts
) -> Composition | Problem:
    """One node more in the package of these texts.

    Raises:
        TemplateFaultError: a template cannot be rendered.
    """
    setup_py = add_entry_point(texts.setup_py, entry_point(answers))
    if isinstance(setup_py, Problem):
        return setup_py
    package_xml = add_dependencies(texts.package_xml, dependencies(answers))
    of_the_node = [template for template in templates if NODE_VARIABLE in template.name]
    return Composition(
        files=render_templates(of_the_node, template_variables(answers)),
        edits=(_edited("setup.py", setup_py), _edited("package.xml", package_xml)),
    )


def _edited(name: str, text: str) -> RenderedFile:
    return RenderedFile(path=PurePosixPath(name), content=text.encode())
