"""What a config asks for and the launcher does not do yet."""

from dataclasses import replace
from pathlib import Path

from obk_cli.cli.config_options import make_options
from obk_cli.cli.launch import _unsupported
from obk_cli.config import Stack
from obk_cli.pipeline import compile_config


def dummy(repository: Path, *overrides: str) -> Stack:
    path = repository / "examples" / "dummy" / "dummy.yaml"
    config = compile_config(str(path), make_options(list(overrides), None)).config
    assert config is not None
    return config


def test_the_dummy_asks_for_nothing_of_the_kind(repository: Path) -> None:
    assert not list(_unsupported(dummy(repository, "onboard.control[0].on_crash=stop")))


def test_other_ends_of_a_crash_are_told(repository: Path) -> None:
    stack = dummy(
        repository, "onboard.control[0].on_crash=restart", "onboard.robot[0].respawn=true"
    )
    crash, respawn = _unsupported(stack)
    assert "not supported yet: `on_crash: restart`" in crash
    assert "obelisk_control_0 crashes" in crash
    assert "not supported yet: `respawn: true`" in respawn


def test_a_second_device_is_told(repository: Path) -> None:
    stack = dummy(repository)
    first, *others = stack.nodes
    told = list(_unsupported(replace(stack, nodes=(replace(first, device="offboard"), *others))))
    assert told == [
        "not supported yet: several devices; the nodes of offboard, onboard all run here"
    ]
