"""Answers, templates and packages in memory for the scaffolding tests."""

from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import Any

import pytest

from obk_cli.files import resource_folder
from obk_cli.scaffold.compose import compose_package, layers_of
from obk_cli.scaffold.kinds import Kind
from obk_cli.scaffold.questions import Answers, Question, check_answers
from obk_cli.scaffold.templates import Library, RenderedFile, Template


def nobody(_name: str) -> str | None:
    """Nobody owns any name."""
    return None


@pytest.fixture
def answer() -> Callable[..., Answers]:
    """Checked answers from what a user would type."""

    def make(kind: Kind = "controller", name: str = "foo", **typed: Any) -> Answers:
        answers = check_answers(Question(kind=kind, name=name, **typed), owner_of=nobody)
        assert isinstance(answers, Answers), answers
        return answers

    return make


@pytest.fixture
def templates() -> Callable[[Answers], tuple[Template, ...]]:
    """The project's own templates for what was answered."""
    return lambda answers: Library(own=resource_folder("templates")).read(layers_of(answers))


@pytest.fixture
def package(
    answer: Callable[..., Answers], templates: Callable[[Answers], tuple[Template, ...]]
) -> Callable[..., dict[PurePosixPath, RenderedFile]]:
    """The files of a package, by path."""

    def make(
        kind: Kind = "controller", name: str = "foo", **typed: Any
    ) -> dict[PurePosixPath, RenderedFile]:
        answers = answer(kind, name, **typed)
        made = compose_package(answers, templates(answers))
        assert made.edits == ()
        return {file.path: file for file in made.files}

    return make


@pytest.fixture
def tree() -> Callable[[Path], dict[str, bytes]]:
    """Every file below a folder with its bytes, hidden ones too."""
    return lambda root: {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }
