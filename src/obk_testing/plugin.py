"""The pytest plugin: the fixtures `stack` and `seed`, in which a config runs in lock-step.

Load it with `-p obk_testing.plugin`, as `obk test` does, so that simulated time is in place before
test modules and nodes are imported.
"""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

# Before the first import of rclpy and numpy: no other process sees the nodes, and sums are made in
# one order.
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import pytest  # noqa: E402

from obelisk_py.core.lockstep.interception import intercepted  # noqa: E402
from obk_testing.programs import LoadedStacks  # noqa: E402
from obk_testing.trial import Schedule, StackTrial  # noqa: E402

__all__ = ["OVERRIDES", "TRIALS", "StartStack"]

OVERRIDES = pytest.StashKey[tuple[Path, tuple[str, ...]]]()
"""Of the session's config: a config, and `path=value` for each of its trials, before `set`."""
TRIALS = pytest.StashKey[list[StackTrial]]()
"""Of a test: the trials that it has started."""
_INTERCEPTION = pytest.StashKey[ExitStack]()


class StartStack(Protocol):
    """What the fixture `stack` is."""

    def __call__(
        self,
        config: str | Path,
        *,
        seed: int = 0,
        parameters: Mapping[str, Mapping[str, Any]] | None = None,
        set: Sequence[str] = (),
        keyframe: str | None = None,
        latency: float = 0.0,
        jitter: float = 0.0,
        phases: bool = False,
        compute: Mapping[str, float] | None = None,
        bring_up: Mapping[str, float] | None = None,
        watch: Iterable[str] = (),
        record: Iterable[str] | None = None,
        without: Iterable[str] = (),
    ) -> StackTrial:
        """Bring a stack up in lock-step.

        Args:
            config: path, relative to the folder of the test.
            seed: of everything that is drawn.
            parameters: node -> parameter -> value, before the nodes are configured.
            set: changes of the config, as `obk launch --set` takes them.
            keyframe: where the simulation starts.
            latency: from the publication of a message to its arrival [s].
            jitter: the most that is added to it, drawn for each message [s].
            phases: whether timers start at a drawn part of their period.
            compute: node -> time that each of its callbacks takes [s].
            bring_up: node -> when it becomes active [s].
            watch: topics that are published although no node subscribes.
            record: topics whose messages are kept; None: all.
            without: nodes that are left out.

        Returns:
            The trial, at time 0, with active nodes.
        """


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of the plugin."""
    group = parser.getgroup("obk", "closed-loop tests")
    group.addoption(
        "--seeds",
        default="1",
        help="run tests with `seed` for so many seeds; `=17` for one of them",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Put simulated time in place."""
    config.stash[_INTERCEPTION] = ExitStack()
    config.stash[_INTERCEPTION].enter_context(intercepted())


def pytest_unconfigure(config: pytest.Config) -> None:
    """Restore the functions of the system."""
    config.stash[_INTERCEPTION].close()


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that asks for `seed` for each of the seeds."""
    if "seed" in metafunc.fixturenames:
        given = metafunc.config.getoption("--seeds")
        seeds = [int(given[1:])] if given.startswith("=") else range(int(given))
        metafunc.parametrize("seed", seeds, ids=[f"seed{seed}" for seed in seeds])


@pytest.fixture(scope="session")
def _stacks() -> Iterator[LoadedStacks]:
    stacks = LoadedStacks()
    yield stacks
    stacks.close()


@pytest.fixture
def stack(request: pytest.FixtureRequest, _stacks: LoadedStacks) -> Iterator[StartStack]:
    """`stack("my_robot.yaml")` brings a config up in lock-step; see `StartStack`."""
    changed, changes = request.config.stash.get(OVERRIDES, (Path(), ()))
    started = request.node.stash.setdefault(TRIALS, [])
    with ExitStack() as trials:

        def start(config: str | Path, **options: Any) -> StackTrial:
            path = (request.path.parent / config).resolve()
            overrides, without = tuple(options.pop("set", ())), tuple(options.pop("without", ()))
            if path == changed:
                overrides = (*changes, *overrides)
            loaded = _stacks.get(path, overrides, without=without)
            schedule = Schedule(
                **{
                    name: options.pop(name)
                    for name in ("latency", "jitter", "phases", "compute", "bring_up")
                    if options.get(name) is not None
                }
            )
            trial = trials.enter_context(StackTrial(loaded, schedule=schedule, **options))
            started.append(trial)
            return trial

        yield start
    started.clear()
    _stacks.trim()
