"""The processes that are forked from the preload server."""

import sys

import pytest

from obk_cli.launch.preloading import Preload, preload_for

COMMON = {"HOME": "/h", "PYTHONPATH": "/a:/b", "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
NODE = (sys.executable, "-P", "-m", "package.node", "--ros-args")
SERVER = Preload(environment=COMMON)


@pytest.mark.parametrize(
    ("added", "variables", "path"),
    [
        ({}, {}, []),
        ({"OBK_CLOCK": "4,5"}, {"OBK_CLOCK": "4,5"}, []),
        ({"AMENT_PREFIX_PATH": "/p"}, {"AMENT_PREFIX_PATH": "/p"}, []),
        ({"PYTHONPATH": "/src:/a:/b"}, {"PYTHONPATH": "/src:/a:/b"}, ["/src"]),
    ],
)
def test_a_python_node_is_forked_with_all_its_settings(
    added: dict[str, str], variables: dict[str, str], path: list[str]
) -> None:
    requested = SERVER.forked(NODE, COMMON | added)
    assert requested == {"arguments": NODE, "variables": variables, "path": path}


@pytest.mark.parametrize(
    "added",
    [
        {"OMP_NUM_THREADS": "1"},
        {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"},
        {"PYTHONPATH": "/b:/a"},
        {"PYTHONPATH": "/a:/src:/b"},
        {"PYTHONHASHSEED": "0"},
        {"LD_LIBRARY_PATH": "/lib"},
    ],
)
def test_a_node_with_another_environment_starts_by_itself(added: dict[str, str]) -> None:
    assert SERVER.forked(NODE, COMMON | added) is None


def test_a_node_that_lacks_a_variable_starts_by_itself() -> None:
    assert SERVER.forked(NODE, {"PYTHONPATH": "/a:/b"}) is None


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("/opt/other/bin/python", "-P", "-m", "package.node"),
        (sys.executable, "-O", "-m", "package.node"),
        (sys.executable, "node.py"),
        ("/ws/install/lib/package/node",),
    ],
)
def test_programs_that_need_another_start_are_not_forked(
    arguments: tuple[str, ...],
) -> None:
    assert SERVER.forked(arguments, COMMON) is None


def test_a_server_exists_for_two_nodes_unless_it_is_disabled() -> None:
    assert preload_for([NODE, NODE], COMMON) == SERVER
    assert preload_for([NODE, ()], COMMON) is None
    assert preload_for([NODE, NODE], {**COMMON, "OBK_PRELOAD": "off"}) is None
    assert preload_for([NODE, NODE], {**COMMON, "COVERAGE_PROCESS_START": "a"}) is None


def test_a_server_fits_environments_that_differ_in_settings_only() -> None:
    assert SERVER.fits(Preload(environment={**COMMON, "OBK_RUN": "1", "AMENT_PREFIX_PATH": "/p"}))
    assert not SERVER.fits(Preload(environment={**COMMON, "LD_LIBRARY_PATH": "/lib"}))
    assert not SERVER.fits(Preload(environment={"HOME": "/h"}))
