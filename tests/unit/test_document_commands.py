"""Commands that documents show: obk knows their options, and a test runs them."""

import re
import shlex
from pathlib import Path

import click
import pytest

from obk_cli.cli.commands import root_command

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    page
    for page in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/*/README.md"))
    if page.parent.name != "rules" and "```sh" in page.read_text(encoding="utf-8")
)
BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.DOTALL | re.MULTILINE)
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
    found = [words[1:] for words in split if words[:1] == ["obk"]]
    return [
        words[: min((words.index(end) for end in ENDS if end in words), default=len(words))]
        for words in found
    ]


SHOWING = [page for page in PAGES if commands(page)]


@pytest.mark.parametrize("page", SHOWING, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_command_line_takes_what_a_document_shows(page: Path) -> None:
    for words in commands(page):
        if words[0].startswith("-"):
            continue
        command, context = root_command(), None
        while isinstance(command, click.Group):
            context = click.Context(command, parent=context, info_name=words[0])
            inner = command.get_command(context, words[0])
            assert inner is not None, words
            command, words = inner, words[1:]
        # Raises where an option or the number of arguments is wrong; nothing is run.
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
