"""What a whole workspace consists of: a stack with a model, a controller and an estimator.

In: the stack's name and templates. Out: files in memory. Never touches the disk.
"""

from collections.abc import Callable
from pathlib import PurePosixPath
from typing import Final

from obk_cli.scaffold.compose import compose_package
from obk_cli.scaffold.kinds import PACKAGE_OF_WORKSPACE_LAYERS, WORKSPACE_LAYER, Kind
from obk_cli.scaffold.library import Library
from obk_cli.scaffold.names import LONGEST_NAME, Problem
from obk_cli.scaffold.questions import Answers, Question, check_answers
from obk_cli.scaffold.render import RenderedFile, render_templates

__all__ = ["LONGEST_STACK_NAME", "check_stack", "compose_workspace"]

_KINDS: Final[tuple[Kind, ...]] = ("controller", "estimator")

LONGEST_STACK_NAME: Final = LONGEST_NAME - len("_controller")
"""So that the packages' names are none too long [characters]."""


def check_stack(
    stack: str, *, owner_of: Callable[[str], str | None]
) -> tuple[Answers, ...] | Problem:
    """The two packages of a stack of that (checked) name, or why there can be none."""
    if len(stack) > LONGEST_STACK_NAME:
        return Problem(
            sentence=f"the name `{stack}` has {len(stack)} characters; "
            f"at most {LONGEST_STACK_NAME} were expected",
            help="packages are named after it; choose a shorter name",
        )
    found: list[Answers] = []
    for kind in _KINDS:
        question = Question(kind=kind, name=f"{stack}_{kind}", sensor_msg="ObkJointEncoders")
        answers = check_answers(question, owner_of=owner_of)
        if not isinstance(answers, Answers):
            return answers[0]
        found.append(answers)
    return tuple(found)


def compose_workspace(
    stack: str, packages: tuple[Answers, ...], library: Library
) -> tuple[RenderedFile, ...]:
    """All files, by their paths in the workspace.

    Raises:
        TemplateFaultError: a template cannot be rendered.
    """
    files = [*render_templates(library.read([WORKSPACE_LAYER]), {"stack": stack})]
    for answers in packages:
        templates = library.read(PACKAGE_OF_WORKSPACE_LAYERS[answers.kind])
        package = compose_package(answers, templates, topics=f"/{stack}")
        folder = PurePosixPath("src", answers.package)
        files += [
            RenderedFile(path=folder / file.path, content=file.content) for file in package.files
        ]
    return tuple(files)
