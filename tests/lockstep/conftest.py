"""A process that can run nodes in lockstep, for one test file at a time."""

import gc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from obk_testing.programs import LoadedStack, load_stack
from obk_testing.trial import StackTrial

from .world import World, lockstep_process


@pytest.fixture(scope="module", autouse=True)
def _lockstep_process() -> Iterator[None]:
    with lockstep_process():
        yield


@pytest.fixture
def make_world() -> Iterator[Callable[..., World]]:
    """Create runs that are closed after the test; the options are those of `LockstepRun`."""
    worlds: list[World] = []

    def make(**options: Any) -> World:
        worlds.append(World(**options))
        return worlds[-1]

    yield make
    for world in worlds:
        world.close()
    gc.collect()


@pytest.fixture
def world(make_world: Callable[..., World]) -> World:
    """An ideal run without nodes."""
    return make_world()


@pytest.fixture(scope="module")
def _stacks(_lockstep_process: None) -> Iterator[dict[Any, LoadedStack]]:
    stacks: dict[Any, LoadedStack] = {}
    yield stacks
    for stack in stacks.values():
        stack.close()


@pytest.fixture
def start_config(_stacks: dict[Any, LoadedStack]) -> Iterator[Callable[..., StackTrial]]:
    """`start_config(path, "robot.on_crash=ignore", seed=3)` starts a trial; the test closes it."""
    trials: list[StackTrial] = []

    def start(
        config: Path, *overrides: str, without: tuple[str, ...] = (), **options: Any
    ) -> StackTrial:
        key = (config, overrides, without)
        if key not in _stacks:
            _stacks[key] = load_stack(config, overrides, without=without)
        trials.append(StackTrial(_stacks[key], **options))
        return trials[-1]

    yield start
    for trial in trials:
        trial.close()
