"""Commands that documents and `--help` show: obk knows their options; a test runs documents'."""

import re
import shlex
from pathlib import Path

import click
import pytest

from obk_cli.cli.commands import VERBS, root_command

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    page
    for page in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/*/README.md"))
    if page.parent.name != "rules" and "```sh" in page.read_text(encoding="utf-8")
)
BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.DOTALL | re.MULTILINE)
HELP = ROOT / "docs" / "reference" / "commands.md"
EXAMPLE = re.compile(r"^  (?:Example:|        ) (obk .+)$", re.MULTILINE)
ENDS = ("&", "||", "|", ">", "&&")
RUN_IN_PART = {
    "docs/how-to/rehearsing.md": "tests/ros/test_rehearsal.py",
    "examples/hardware/README.md": "tests/ros/test_hardware_example.py",
}
"""What would take minutes whole, or two terminals -> the tests that do the same in parts."""


def commands(page: Path) -> list[list[str]]:
    """The words of every `obk` command, without what the shell does with it."""
    lines = "".join(BLOCK.findall(page.read_text())).replace("\\\n", " ").splitlines()
    split = [shlex.split(line, comments=True) for line in lines]
    return [_of_obk(words) for words in split if words[:1] == ["obk"]]


def _of_obk(words: list[str]) -> list[str]:
    end = min((words.index(end) for end in ENDS if end in words), default=len(words))
    return words[1:end]


SHOWING = [page for page in PAGES if commands(page)]
EXAMPLES = EXAMPLE.findall(HELP.read_text())


@pytest.mark.parametrize("page", SHOWING, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_command_line_takes_what_a_document_shows(page: Path) -> None:
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
    """Raises where an option or the number of arguments is wrong; nothing is run."""
    command, context = root_command(), None
    while isinstance(command, click.Group) and not words[0].startswith("-"):
        context = click.Context(command, parent=context, info_name=words[0])
        inner = command.get_command(context, words[0])
        assert inner is not None, words
        command, words = inner, words[1:]
    command.make_context(command.name, list(words), parent=context)


@pytest.mark.parametrize("page", SHOWING, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_commands_of_a_document_are_run_by_a_test(page: Path) -> None:
    name = str(page.relative_to(ROOT))
    if name in RUN_IN_PART:
        assert (ROOT / RUN_IN_PART[name]).is_file()
        return
    parts = re.escape(page.name)
    if page.parent != ROOT:
        parts = rf'{re.escape(page.parent.name)}["/ ]+{parts}'
    others = (path for path in ROOT.glob("tests/**/*.py") if path != Path(__file__))
    assert any(re.search(parts, path.read_text(encoding="utf-8")) for path in others), name
