"""Each config in `add_node/` is a test that adds a node to it.

The first line defines the node: `# add: SECTION [device=NAME] [replaces=NODE]`. The entry of the
node is in `new_SECTION.part`. The report is in the `.txt` next to the config, the new text in the
`.after`; configs that reject the node have no `.after`.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from obk_cli.compiler import Options
from obk_cli.configedit.add_node import add_node
from obk_cli.configedit.new_node import Rejected, read_new_node
from obk_cli.configedit.report import AddedNode, added_lines
from obk_cli.diagnostics.source import SourceFile
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import PackageIndex

HERE = Path(__file__).parent
CASES = sorted((HERE / "add_node").glob("*.yaml"))


def options() -> Options:
    folder = HERE / "add_node"
    environment = MachineEnvironment(folder, folder, {})
    environment.packages = PackageIndex(workspaces=(HERE / "workspace",), prefixes=())
    return Options(variables={}, working_folder=folder, environment=environment)


def result_of(path: Path, text: str) -> AddedNode | Rejected:
    section, *words = text.splitlines()[0].removeprefix("# add: ").split()
    chosen = dict(word.split("=") for word in words)
    new_node = read_new_node(section, (HERE / "add_node" / f"new_{section}.part").read_text())
    return add_node(
        SourceFile.of(path.name, text),
        new_node,
        options(),
        device=chosen.get("device"),
        replaces=chosen.get("replaces"),
    )


def report_on(result: AddedNode | Rejected) -> Iterator[str]:
    if isinstance(result, AddedNode):
        yield from added_lines(result)
        return
    yield from (str(finding) for finding in result.findings)
    yield result.sentence
    yield f"help: {result.help}"
    yield from result.snippet.splitlines()


@pytest.fixture(autouse=True)
def _in_case_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(HERE / "add_node")


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_a_node_is_added_as_expected(path: Path, request: pytest.FixtureRequest) -> None:
    result = result_of(path, path.read_text(encoding="utf-8"))
    report = "".join(f"{line}\n" for line in report_on(result))
    expected, after = path.with_suffix(".txt"), path.with_suffix(".after")
    if request.config.getoption("--update-golden"):
        expected.write_text(report, encoding="utf-8")
        if isinstance(result, AddedNode):
            after.write_text(result.text, encoding="utf-8")
    assert report == expected.read_text(encoding="utf-8")
    assert isinstance(result, AddedNode) == after.exists() == (not path.stem.startswith("refused"))
    if isinstance(result, AddedNode):
        assert result.text == after.read_text(encoding="utf-8")
