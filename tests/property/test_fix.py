"""Fixes of any config: no exceptions, no new errors, and a second run finds nothing to fix."""

import random
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from obk_cli.compiler import Options
from obk_cli.configedit.autofix import Fixed, fix_config
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import PackageIndex

CORPUS = Path(__file__).resolve().parents[3] / "shared" / "corpus"
SEEDS = [path.read_text() for path in sorted(CORPUS.rglob("*.yaml"))]


def fixed(text: str, folder: Path) -> Fixed:
    """The fixes of source text without a file."""
    environment = MachineEnvironment(folder, folder, {})
    environment.packages = PackageIndex(workspaces=(), prefixes=())
    options = Options(
        variables={},
        working_folder=folder,
        environment=environment,
        read=lambda path: text.encode() if path == "c.yaml" else "file not found",
    )
    return fix_config("c.yaml", options, lambda path: path.name == "c.yaml")


def errors(result: Fixed) -> tuple[int, int]:
    return (
        sum(finding.severity == "error" for finding in result.before.diagnostics),
        sum(finding.severity == "error" for finding in result.after.diagnostics),
    )


def with_typing_mistakes(text: str, seed: int) -> str:
    """Text with a few letters left out, doubled or swapped, like typing mistakes."""
    draw = random.Random(seed)
    for _ in range(draw.randint(1, 6)):
        at = draw.randrange(len(text) - 1)
        one, two = text[at], text[at + 1]
        text = text[:at] + draw.choice(["", one + one, two + one]) + text[at + 1 :]
    return text


@given(st.sampled_from(SEEDS), st.integers())
def test_typing_mistakes_in_any_config_are_fixed_or_left(text: str, seed: int) -> None:
    first = fixed(with_typing_mistakes(text, seed), CORPUS / "nowhere")
    before, after = errors(first)
    assert after <= before
    for _, new in first.files:
        second = fixed(new, CORPUS / "nowhere")
        assert second.done == ()
        assert second.before.diagnostics == first.after.diagnostics
