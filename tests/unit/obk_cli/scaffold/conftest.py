"""Answers, templates and packages in memory for the scaffolding tests."""

from collections.abc import Callable
from pathlib import Path, PurePosixPath

import pytest

from obk_cli.resources import resource_folder
from obk_cli.scaffold.compose import LAYERS, compose_package
from obk_cli.scaffold.questions import Answers, Kind, Question, check_answers
from obk_cli.scaffold.render import RenderedFile, Template, read_templates


def nobody(_name: str) -> str | None:
    """Nobody owns any name."""
    return None


@pytest.fixture
def answer() -> Callable[..., Answers]:
    """Checked answers from what a user would type."""

    def make(kind: Kind = "controller", name: str = "foo", **typed: str) -> Answers:
        answers = check_answers(Question(kind=kind, name=name, **typed), owner_of=nobody)
        assert isinstance(answers, Answers), answers
        return answers

    return make


@pytest.fixture
def templates() -> Callable[[Kind], tuple[Template, ...]]:
    """The project's own templates of a kind."""
    return lambda kind: read_templates(resource_folder("templates") / x for x in LAYERS[kind])


@pytest.fixture
def package(
    answer: Callable[..., Answers], templates: Callable[[Kind], tuple[Template, ...]]
) -> Callable[..., dict[PurePosixPath, RenderedFile]]:
    """The files of a package, by path."""

    def make(
        kind: Kind = "controller", name: str = "foo", **typed: str
    ) -> dict[PurePosixPath, RenderedFile]:
        made = compose_package(answer(kind, name, **typed), templates(kind))
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
