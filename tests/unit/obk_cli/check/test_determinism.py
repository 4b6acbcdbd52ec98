"""The nodes of a config that run in lockstep, when that is checked, and how to silence it."""

from pathlib import Path

import pytest

from obk_cli.compiler import Options, Outcome, compile_config

EXAMPLES = Path(__file__).parents[4] / "examples"
SETUP = "setup(entry_points={'console_scripts': ['run = demo.run:main']})"
NODE = """\
import threading

import rclpy
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.utils.ros import spin_obelisk


class Mine(ObeliskNode):
    def __init__(self):
        super().__init__("mine")
        self.register_obk_timer("timer_x_setting", self.tick, key="timer_x")

    def tick(self):
        BODY


def main():
    spin_obelisk(None, Mine)
"""
CONFIG = """\
config: demo
sensing:
  - pkg: demo
    executable: run
    timers:
      - {key: timer_x, timer_period_sec: 0.1}
"""


def compiled(folder: Path, config: str = "demo.yaml", *, for_test: bool = True) -> Outcome:
    ignore = ("OBK2", "OBK3")
    options = Options(variables={}, working_folder=folder, for_test=for_test, ignore=ignore)
    return compile_config(str(folder / config), options)


def found(outcome: Outcome) -> list[str]:
    return [finding.code for finding in outcome.diagnostics]


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    package = tmp_path / "src" / "demo"
    (package / "demo").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>demo</name></package>")
    (package / "setup.py").write_text(SETUP)
    (tmp_path / "demo.yaml").write_text(CONFIG)
    return tmp_path


def write_node(workspace: Path, body: str) -> None:
    (workspace / "src/demo/demo/run.py").write_text(NODE.replace("BODY", body))


@pytest.mark.parametrize(
    ("config", "codes"),
    [
        ("dummy/dummy.yaml", []),
        ("dummy/dummy_new.yaml", []),
        ("arm/arm.yaml", []),
        ("quadruped/quadruped.yaml", []),
        ("hardware/hardware.yaml", ["OBK613"]),
    ],
)
def test_the_examples_have_no_hazard_but_hardware(config: str, codes: list[str]) -> None:
    path = EXAMPLES / config
    outcome = compiled(path.parent, path.name)
    assert outcome.plan is not None
    assert [hazard.code for hazard in outcome.hazards] == codes


def test_hazards_are_infos_and_checked_on_request_only(workspace: Path) -> None:
    write_node(workspace, "threading.Thread(target=print).start()")
    outcome = compiled(workspace)
    assert [(h.code, h.severity) for h in outcome.hazards] == [("OBK601", "info")]
    assert outcome.hazards == outcome.diagnostics
    assert outcome.hazards[0].span.path == "src/demo/demo/run.py"
    assert found(compiled(workspace, for_test=False)) == []


def test_a_comment_in_the_source_silences_a_hazard(workspace: Path) -> None:
    write_node(workspace, "threading.Thread(target=print).start()  # obk: ignore[OBK601]")
    assert found(compiled(workspace)) == []


def test_a_callback_that_spins_its_node_is_one_warning(workspace: Path) -> None:
    write_node(workspace, "rclpy.spin_once(self)")
    assert found(compiled(workspace)) == found(compiled(workspace, for_test=False)) == ["OBK426"]


def test_an_executable_of_machine_code_is_not_in_lockstep_runs(workspace: Path) -> None:
    package = workspace / "src/demo"
    (package / "setup.py").unlink()
    (package / "scripts").mkdir()
    program = package / "scripts/run"
    program.write_bytes(b"\x7fELF" + bytes(60))
    program.chmod(0o755)
    (hazard,) = compiled(workspace).hazards
    assert hazard.code == "OBK611"
    assert "C++" in hazard.message


def test_an_executable_that_does_not_exist_is_another_rules_finding(workspace: Path) -> None:
    (workspace / "src/demo/setup.py").unlink()
    assert found(compiled(workspace)) == ["OBK402"]
