"""Fixtures of all tests: the checkout's folder, and an isolated ROS domain for ROS tests."""

import compileall
import fcntl
import functools
import gc
import itertools
import os
import signal
import stat
import tempfile
import uuid
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import psutil
import pytest

from obk_cli.process.shared_memory import remove_dead_segments
from obk_cli.ros.environment import (
    AS_THE_PROFILE_SAYS,
    LOCALHOST_PROFILE,
    PROFILES_FILES,
    RANGE,
    SKIP_FOLDER,
)
from obk_cli.source_analysis import modules

_SOURCE = Path(__file__).resolve().parents[1] / "src"
_SHARED = Path(__file__).resolve().parents[2] / "shared"
# The tool searches for a free domain from 100 downwards.
_DOMAIN_IDS = range(1, 81)
# Delete one after another, so that slow removals do not affect the next test.
_TURNS = itertools.count(17 * os.getpid())
_MARK = "OBELISK_TEST_RUN"
_FOREIGN_ROS_VARIABLES = (
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
    "ROS_NAMESPACE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
)
_DDS = {
    PROFILES_FILES[0]: LOCALHOST_PROFILE,
    RANGE: AS_THE_PROFILE_SAYS,
    SKIP_FOLDER: "1",
}
"""DDS as in a launch: over UDP on the loopback device.

Over shared memory, Fast DDS 2.14 crashes at times when a participant is deleted after other
processes were killed: it unmaps ports that it still uses.
"""


# No example is too slow, whatever else the machine does. On CI the examples are always the same;
# `make test-slow`, with `--hypothesis-profile full`, finds faults by chance.
for _profile, _examples in (("ci", 30), ("full", 300)):
    hypothesis.settings.register_profile(
        _profile,
        max_examples=_examples,
        deadline=None,
        suppress_health_check=(hypothesis.HealthCheck.too_slow,),
        derandomize=bool(os.environ.get("CI")),
    )
hypothesis.settings.load_profile("ci")


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--update-golden` rewrites the expected files of the golden tests and the reject cases."""
    parser.addoption("--update-golden", action="store_true", help="rewrite expected outputs")


def pytest_configure(config: pytest.Config) -> None:
    """Compile the tool once, because a thousand processes import it."""
    gc.disable()  # until all tests are collected
    # Fast DDS reads its profile once in a process, before the first participant.
    os.environ.update(_DDS)
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        # Shells start background processes like this, and all processes of a test would inherit it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if not hasattr(config, "workerinput"):
        compileall.compile_dir(_SOURCE, quiet=1)
        config.option.loadscopereorder = False  # the order is set below


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """With several workers, run long files first, so that no worker is left alone with one."""
    if hasattr(config, "workerinput"):
        items.sort(key=lambda item: item.get_closest_marker("ros") is None)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip tests that need configs next to the checkout, unless these exist."""
    module = getattr(item, "module", None)
    for name in ("CORPUS", "SEEDS"):
        folder = getattr(module, name, None)
        if isinstance(folder, Path) and not folder.is_dir():
            assert folder.is_relative_to(_SHARED), f"{name} is no folder of {_SHARED}"
            pytest.skip(f"there is no folder {folder}")


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the checkout."""
    return Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session", autouse=True)
def _quick_collection() -> None:
    """Freeze all existing objects, so that the garbage collector skips them."""
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def _library_parsed_once() -> Iterator[None]:
    """Parse Obelisk's own modules once, because the check of every node's source uses them."""
    with pytest.MonkeyPatch.context() as patch:
        parse = functools.lru_cache(maxsize=64)(modules._syntax_tree)
        patch.setattr(modules, "_syntax_tree", parse)
        yield


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep the cache of a test run separate from the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session", autouse=True)
def _own_folders(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Stop the search for a workspace below the folder of all tests."""
    tmp_path_factory.getbasetemp().chmod(stat.S_IRWXU | stat.S_ISVTX)


@pytest.fixture
def unmeasured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Start processes without coverage, so that they behave as they do for a user.

    Coverage imports modules, writes files at the end, and handles SIGTERM.
    """
    for name in [name for name in os.environ if name.startswith("COV")]:
        monkeypatch.delenv(name)


@pytest.fixture
def ros_domain(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[int]:
    """A domain ID that no other test uses, which isolates processes started by the test.

    It fails the test if one of its processes, or of their children, is still running.
    """
    mark = uuid.uuid4().hex
    with _locked_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
        monkeypatch.setenv(_MARK, mark)
        # The runs of a test must not be in the user's folder.
        monkeypatch.setenv("OBK_HOME", str(tmp_path_factory.mktemp("obk")))
        for name in _FOREIGN_ROS_VARIABLES:
            monkeypatch.delenv(name, raising=False)
        yield domain
        # A lifecycle node is part of reference cycles, and in the domain until they are collected.
        gc.collect()
        left_over = _end_processes_marked(mark)
        remove_dead_segments()  # left by processes that the test killed
        assert not left_over, f"the test left processes behind: {left_over}"


@pytest.fixture(autouse=True)
def _own_world_for_ros_tests(request: pytest.FixtureRequest) -> None:
    if request.node.get_closest_marker("ros"):
        request.getfixturevalue("ros_domain")


class _locked_domain:  # noqa: N801 - used as a `with` word
    """Hold a lock file for one domain ID, so that parallel test runs do not interfere."""

    def __enter__(self) -> int:
        folder = Path(tempfile.gettempdir(), f"obelisk-ros-domains-{os.getuid()}")
        folder.mkdir(exist_ok=True)
        for _ in _DOMAIN_IDS:
            domain = _DOMAIN_IDS[next(_TURNS) % len(_DOMAIN_IDS)]
            self._file = (folder / str(domain)).open("w")
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                self._file.close()
            else:
                return domain
        raise RuntimeError(f"every ROS domain id of {_DOMAIN_IDS} is in use by another test run")

    def __exit__(self, *exception: object) -> None:
        self._file.close()


def _end_processes_marked(mark: str) -> list[str]:
    """Kill processes that have the mark in their environment; return their command lines."""
    left_over = []
    for process in psutil.process_iter():
        try:
            if process.pid != os.getpid() and process.environ().get(_MARK) == mark:
                left_over.append(f"{process.pid}: {' '.join(process.cmdline())}")
                process.kill()
        except psutil.Error:  # has ended, or belongs to another user
            continue
    return left_over
