"""Commands in documents and `--help`: obk knows their options; tests/ros runs them."""

import re
import shlex
from pathlib import Path

import click
import pytest

from obk_cli.cli.commands import VERBS, root_command

from ..documents import (  # noqa: TID252 - shared by folders of tests
    PAGES,
    ROOT,
    blocks,
    page_name,
)

HELP = ROOT / "docs" / "reference" / "commands.md"
EXAMPLE = re.compile(r"^  (?:Example:|        ) (obk .+)$", re.MULTILINE)
ENDS = ("&", "||", "|", ">", "&&")


def commands(page: Path) -> list[list[str]]:
    """The words of every `obk` command, without shell syntax."""
    text = "".join(block.body for block in blocks(page) if block.kind == "sh")
    lines = text.replace("\\\n", " ").splitlines()
    split = [shlex.split(line, comments=True) for line in lines]
    return [_of_obk(words) for words in split if words[:1] == ["obk"]]


def _of_obk(words: list[str]) -> list[str]:
    end = min((words.index(end) for end in ENDS if end in words), default=len(words))
    return words[1:end]


SHOWING = [page for page in PAGES if commands(page)]
EXAMPLES = EXAMPLE.findall(HELP.read_text())


@pytest.mark.parametrize("page", SHOWING, ids=page_name)
def test_the_command_line_accepts_the_commands_of_a_document(page: Path) -> None:
    for words in commands(page):
        if not words[0].startswith("-"):
            take(words)


@pytest.mark.parametrize("line", EXAMPLES)
def test_the_command_line_takes_the_examples_of_its_help(line: str) -> None:
    take(_of_obk(shlex.split(line)))


def test_no_list_of_commands_is_cut_off() -> None:
    assert not re.findall(r"^  \w+ .*\.\.\.$", HELP.read_text(), re.MULTILINE)


def test_the_help_has_examples() -> None:
    assert len(EXAMPLES) >= len(VERBS)


def take(words: list[str]) -> None:
    """Raise if an option or the number of arguments is wrong; run nothing."""
    command, context = root_command(), None
    while isinstance(command, click.Group) and not words[0].startswith("-"):
        context = click.Context(command, parent=context, info_name=words[0])
        inner = command.get_command(context, words[0])
        assert inner is not None, words
        command, words = inner, words[1:]
    command.make_context(command.name, list(words), parent=context)
