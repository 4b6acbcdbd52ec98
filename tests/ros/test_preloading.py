"""Stacks whose Python nodes are forked from the preload server."""

import shutil
from pathlib import Path

import psutil
import pytest

from obk_cli.process import preload

from .stack import DUMMY, Launched, arguments_of, eventually, launched, marked, started

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("unmeasured")]

NODES = ("obelisk_control_0", "obelisk_estimation_0", "obelisk_robot_0")


@pytest.fixture(autouse=True)
def _own_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))


def processes_with(argument: str) -> list[psutil.Process]:
    """The processes of this test with an argument."""
    return [process for process in marked() if argument in arguments_of(process)]


def the_one_with(argument: str, run: Launched) -> psutil.Process:
    """Wait for the only process of this test with an argument."""
    found: list[psutil.Process] = []

    def is_there() -> bool:
        found[:] = processes_with(argument)
        return len(found) == 1

    eventually(is_there, f"one process with {argument}", seen=lambda: run.text)
    return found[0]


def is_forked(process: psutil.Process) -> bool:
    """Whether a process's arguments are not on the stack that `exec` creates."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    start_stack, arguments = int(fields[28 - 3]), int(fields[48 - 3])
    return arguments < start_stack


def test_nodes_are_forked_except_one_with_its_own_variable(tmp_path: Path) -> None:
    config = shutil.copytree(DUMMY.parent, tmp_path / "dummy") / DUMMY.name
    entry = "executable: example_position_setpoint_controller"
    text = DUMMY.read_text()
    config.write_text(text.replace(entry, f"{entry}\n      env: {{OMP_NUM_THREADS: '1'}}"))
    with launched(config, "--quiet") as run:
        nodes = [run.node(name) for name in NODES]
        assert [is_forked(node) for node in nodes] == [False, True, True]
        alone, *forked = (node.environ() for node in nodes)
        assert alone["OMP_NUM_THREADS"] == "1"
        assert not any("OMP_NUM_THREADS" in variables for variables in forked)
        assert len({node.ppid() for node in (*nodes, the_one_with(preload.__file__, run))}) == 1
    assert run.process.returncode == 0, run.text
    assert not run.left_over()


def test_nodes_share_the_type_supports_that_the_server_has_loaded() -> None:
    with launched(DUMMY, "--quiet") as run:
        server = _type_supports(the_one_with(preload.__file__, run))
        for name in NODES[:2]:  # the simulator uses further messages
            assert _type_supports(run.node(name)) <= server
    assert server
    assert not run.left_over()


def _type_supports(process: psutil.Process) -> set[str]:
    """The libraries that describe ROS types to the middleware."""
    paths = (Path(mapped.path).name for mapped in process.memory_maps())
    return {name for name in paths if "__rosidl_typesupport_" in name}


def test_a_restarted_node_is_forked_while_the_server_is_running() -> None:
    name = f"__node:={NODES[0]}"
    with launched(DUMMY, "--quiet", "--on-crash", "restart") as run:
        for activations, has_server in ((2, True), (3, False)):
            if not has_server:
                the_one_with(preload.__file__, run).kill()
            the_one_with(name, run).kill()
            _wait_for_activations(run, activations)
            assert is_forked(the_one_with(name, run)) == has_server
    assert run.process.returncode == 0, run.text
    assert not marked()


def _wait_for_activations(run: Launched, count: int) -> None:
    def is_active() -> bool:
        return sum("control_0: activate ok" in line for line in run.lines) == count

    eventually(is_active, "the node's return", seen=lambda: run.text)


@pytest.mark.parametrize("is_up", [False, True])
def test_the_stack_survives_the_loss_of_the_server(is_up: bool) -> None:
    with started(DUMMY, "--quiet") as run:
        if is_up:
            run.wait_for("active")
        the_one_with(preload.__file__, run).kill()
        run.wait_for("active")
    assert run.process.returncode == 0, run.text
    assert not marked()
