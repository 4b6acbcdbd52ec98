"""A config dropped into `joining/` is a test: a new node is put into it.

The first line says which: `# join: SECTION [device=NAME] [replaces=NODE]`. The node is that of
`new_SECTION.part`. What is told stands in the `.txt` beside the config, the new text in the
`.after`; a config that refuses the node has none.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from obk_cli.compiler import Options
from obk_cli.diagnostics.source import SourceFile
from obk_cli.joining.join import Joined, join_node
from obk_cli.joining.newcomer import read_newcomer
from obk_cli.joining.refusal import Refused
from obk_cli.joining.tell import joined_lines
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import PackageIndex

HERE = Path(__file__).parent
CASES = sorted((HERE / "joining").glob("*.yaml"))


def options() -> Options:
    folder = HERE / "joining"
    environment = MachineEnvironment(folder, folder, {})
    environment.packages = PackageIndex(workspaces=(HERE / "workspace",), prefixes=())
    return Options(variables={}, working_folder=folder, environment=environment)


def join(path: Path, text: str) -> Joined | Refused:
    section, *words = text.splitlines()[0].removeprefix("# join: ").split()
    chosen = dict(word.split("=") for word in words)
    newcomer = read_newcomer(section, (HERE / "joining" / f"new_{section}.part").read_text())
    return join_node(
        SourceFile.of(path.name, text),
        newcomer,
        options(),
        device=chosen.get("device"),
        replaces=chosen.get("replaces"),
    )


def told(result: Joined | Refused) -> Iterator[str]:
    if isinstance(result, Joined):
        yield from joined_lines(result)
        return
    yield from (str(finding) for finding in result.findings)
    yield result.sentence
    yield f"help: {result.help}"


@pytest.fixture(autouse=True)
def _beside_the_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(HERE / "joining")


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_a_node_joins_as_expected(path: Path, request: pytest.FixtureRequest) -> None:
    result = join(path, path.read_text(encoding="utf-8"))
    report = "".join(f"{line}\n" for line in told(result))
    expected, after = path.with_suffix(".txt"), path.with_suffix(".after")
    if request.config.getoption("--update-golden"):
        expected.write_text(report, encoding="utf-8")
        if isinstance(result, Joined):
            after.write_text(result.text, encoding="utf-8")
    assert report == expected.read_text(encoding="utf-8")
    assert isinstance(result, Joined) == after.exists() == (not path.stem.startswith("refused"))
    if isinstance(result, Joined):
        assert result.text == after.read_text(encoding="utf-8")
