"""The example nodes with one mistake each: found at its location, and nothing else is.

Every class, key, callback, import and base constructor of their sources is misspelled once, like a
typing mistake.
"""

import ast
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from obk_cli.compiler import Options, compile_config
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.workspace.environment import MachineEnvironment

EXAMPLES = Path(__file__).parents[4] / "examples"
STACKS = ("arm", "quadruped", "hardware")
ALWAYS = "arm"
"""The stack whose nodes have all kinds of mistakes; the other stacks are slow tests."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mistake:
    """A piece of a source file, its replacement, and the expected finding."""

    stack: str
    file: Path
    code: str
    line: int
    start: int
    end: int
    wrong: str
    found_on: int
    """The line of the finding."""

    def __str__(self) -> str:
        return f"{self.file.stem}-{self.line}-{self.code}-{self.wrong}"


def misspelt(word: str) -> str:
    """Swap two letters in the middle; leave one out if they are equal."""
    at = len(word) // 2
    swapped = word[: at - 1] + word[at] + word[at - 1] + word[at + 1 :]
    return swapped if swapped != word else word[:at] + word[at + 1 :]


def mistakes() -> Iterator[Mistake]:
    for stack in STACKS:
        for file in sorted((EXAMPLES / stack / "src").rglob("*.py")):
            text = file.read_text(encoding="utf-8")
            if "spin_obelisk(" in text:
                yield from mistakes_in(stack, file, text)


def mistakes_in(stack: str, file: Path, text: str) -> Iterator[Mistake]:
    lines = text.splitlines()

    def in_line(
        code: str, number: int, word: str, after: int = 0, found_on: int | None = None
    ) -> Mistake:
        start = lines[number - 1].index(word, after)
        return Mistake(
            stack=stack,
            file=file.relative_to(EXAMPLES),
            code=code,
            line=number,
            start=start,
            end=start + len(word),
            wrong=misspelt(word),
            found_on=found_on or number,
        )

    package = file.parent.name
    tree = ast.parse(text)
    defined = {
        node.name: node.lineno
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef | ast.FunctionDef)
    }
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name(id="spin_obelisk"), args=[_, ast.Name(id=name), *_]):
                yield in_line("OBK420", node.lineno, name)
                yield in_line("OBK420", defined[name], name, found_on=node.lineno)
            case ast.ImportFrom(module=str(module), names=[alias, *_]) if module.partition(".")[
                0
            ] in (package, "obelisk_py"):
                parent, _, last = module.rpartition(".")
                yield in_line("OBK421", node.lineno, last, len(f"from {parent}."))
                yield in_line("OBK421", alias.lineno, alias.name, alias.col_offset)
            case ast.Subscript(
                value=ast.Attribute(attr="obk_publishers" | "obk_subscriptions" | "obk_timers"),
                slice=ast.Constant(value=str(key)),
            ):
                yield in_line("OBK423", node.slice.lineno, key, node.slice.col_offset)
            case ast.Call(func=ast.Attribute(attr=method), args=[_, ast.Attribute(attr=name), *_]):
                if method.startswith("register_obk_"):
                    use = node.args[1].lineno
                    yield in_line("OBK424", use, name)
                    yield in_line("OBK424", defined[name], name, found_on=use)
            case ast.Call(
                func=ast.Attribute(value=ast.Call(func=ast.Name(id="super")), attr="__init__")
            ):
                found = in_line(
                    "OBK422", node.lineno, "super().__init__", found_on=defined["__init__"]
                )
                yield replace(found, wrong="dict")


def findings(folder: Path, config: str) -> list[Diagnostic]:
    """The findings of the source check in a stack."""
    environment = MachineEnvironment(folder, folder, {})
    options = Options(variables={}, working_folder=folder, environment=environment)
    outcome = compile_config(str(folder / config), options)
    assert outcome.config is not None
    return [d for d in outcome.diagnostics if d.code.startswith("OBK4") or d.code == "OBK317"]


@pytest.mark.parametrize(
    "mistake",
    [
        pytest.param(mistake, marks=[] if mistake.stack == ALWAYS else [pytest.mark.slow])
        for mistake in mistakes()
    ],
    ids=str,
)
def test_one_mistake_gives_one_finding_at_its_location(mistake: Mistake, tmp_path: Path) -> None:
    folder = tmp_path / mistake.stack
    shutil.copytree(EXAMPLES / mistake.stack, folder)
    file = tmp_path / mistake.file
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    line = lines[mistake.line - 1]
    lines[mistake.line - 1] = line[: mistake.start] + mistake.wrong + line[mistake.end :]
    file.write_text("".join(lines), encoding="utf-8")
    (found,) = findings(folder, f"{mistake.stack}.yaml")
    assert found.code == mistake.code
    assert folder / found.span.path == file
    assert found.span.line == mistake.found_on
    if mistake.code != "OBK422" and mistake.found_on == mistake.line:
        assert found.span.column <= mistake.start + 1 < found.span.first_line_end


@pytest.mark.parametrize("stack", [*STACKS, "dummy"])
def test_nothing_is_found_in_the_examples_as_they_are(stack: str, tmp_path: Path) -> None:
    shutil.copytree(EXAMPLES / stack, tmp_path / stack)
    assert not findings(tmp_path / stack, f"{stack}.yaml")
