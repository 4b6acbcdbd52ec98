"""One stack on two hosts, as in `docs/how-to/two-machines.md`.

A host is a network namespace with its own launcher; a virtual cable connects the two.
"""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from signal import SIGINT

import pytest

from ..documents import Edit, apply, steps  # noqa: TID252 - shared by folders of tests
from .stack import DEADLINE_S, DUMMY, OBK, Launched, eventually, patient

pytestmark = pytest.mark.ros

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "two-machines.md"
LOST_CONTACT_S = 60.0
HANG_AFTER = ("--hang-after", "5")
"""A timeout short enough for the test of a missing node, and long enough for one that waits."""
OWN_SHARED_MEMORY = 'mount -t tmpfs tmpfs /dev/shm && exec "$0" "$@"'
ROBOT, ESTIMATOR, CONTROLLER = (
    "/obelisk_robot_0",
    "/obelisk_estimation_0",
    "/obelisk_control_0",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Host:
    """A network namespace, with its own home and shared memory."""

    name: str
    home: Path

    def command(self, *command: object) -> list[str]:
        inside = ["sh", "-c", OWN_SHARED_MEMORY, *map(str, command)]
        return ["ip", "netns", "exec", self.name, *inside]

    @property
    def environment(self) -> dict[str, str]:
        return {**os.environ, "OBK_HOME": str(self.home)}

    def obk(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            self.command(OBK, *arguments),
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=DEADLINE_S,
            check=False,
        )

    @contextmanager
    def launched(self, config: Path, device: str) -> Iterator[Launched]:
        words = ("launch", config, "--device", device, "--quiet", "--ignore", "OBK", *HANG_AFTER)
        process = subprocess.Popen(
            self.command(OBK, *patient(*words)),
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        run = Launched(process)
        try:
            yield run
        finally:
            if process.poll() is None:
                process.send_signal(SIGINT)
            process.wait(LOST_CONTACT_S)
            run.reader.join()


@pytest.fixture
def hosts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Host, Host]]:
    """Two hosts that reach each other, and no other host."""
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
    names = [f"obk{os.getpid()}{end}" for end in "ab"]
    ends = [f"{name}v" for name in names]
    with ExitStack() as stack:
        for name in names:
            made = _ip("netns", "add", name)
            if made.returncode != 0:
                pytest.skip(f"network namespaces are not allowed here: {made.stderr.strip()}")
            stack.callback(_ip, "netns", "delete", name)
        cable = ["type", "veth", "peer", "name", ends[1], "netns", names[1]]
        _ip_done("link", "add", ends[0], "netns", names[0], *cable)
        joined = tuple(zip(names, ends, strict=True))
        for number, (name, end) in enumerate(joined, 1):
            _ip_done("-n", name, "link", "set", "lo", "up")
            _ip_done("-n", name, "address", "add", f"10.77.0.{number}/24", "dev", end)
            _ip_done("-n", name, "link", "set", end, "up")
        for name, end in joined:
            # It takes a moment, and DDS ignores interfaces that are down when a process starts.
            eventually(lambda name=name, end=end: _is_up(name, end), f"the link {end}")
        first, second = (Host(name=name, home=tmp_path / name) for name in names)
        yield first, second


def _is_up(name: str, end: str) -> bool:
    state = _ip("netns", "exec", name, "cat", f"/sys/class/net/{end}/operstate")
    return state.stdout.strip() == "up"


def _ip(*arguments: str) -> "subprocess.CompletedProcess[str]":
    try:
        return subprocess.run(["ip", *arguments], capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        return subprocess.CompletedProcess(["ip"], 1, "", str(error))


def _ip_done(*arguments: str) -> None:
    done = _ip(*arguments)
    assert done.returncode == 0, done.stderr


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """The dummy as the page splits it: its controller on another device than the rest."""
    for file in ("dummy_new.yaml", "dummy.xml", "dummy_params.txt"):
        shutil.copy(DUMMY.with_name(file), tmp_path)
    (edit,) = (step for step in steps(DOCUMENT) if isinstance(step, Edit))
    apply(edit, tmp_path)
    return tmp_path / edit.path


@contextmanager
def both(hosts: tuple[Host, Host], config: Path) -> Iterator[tuple[Launched, Launched]]:
    """The running stack: the lead, which has the controller, and its follower."""
    with hosts[1].launched(config, "onboard") as follower:
        follower.wait_for("ready")
        with hosts[0].launched(config, "offboard") as lead:
            lead.wait_for("active")
            follower.wait_for("following")
            yield lead, follower


def test_the_lead_starts_and_stops_all(hosts: tuple[Host, Host], config: Path) -> None:
    with both(hosts, config) as (lead, follower):
        for node in (ROBOT, ESTIMATOR, CONTROLLER):
            state = hosts[0].obk("lifecycle", "get", node)
            assert state.stdout.split() == [node, "active"], state.stdout + state.stderr
        lead.process.send_signal(SIGINT)
        lead.process.wait(DEADLINE_S)
        follower.process.wait(DEADLINE_S)
    assert lead.process.returncode == 0, lead.text
    assert follower.process.returncode == 0, follower.text
    assert not lead.left_over() + follower.left_over()


@pytest.mark.slow
def test_a_follower_without_its_lead_stops_its_nodes(
    hosts: tuple[Host, Host], config: Path
) -> None:
    with both(hosts, config) as (lead, follower):
        lead.process.kill()
        follower.process.wait(DEADLINE_S)
        eventually(lambda: not lead.left_over(), "the end of the lead's nodes")
    assert follower.process.returncode == 1, follower.text
    assert "lead /dummy " in follower.text
    assert not follower.left_over()


@pytest.mark.slow
def test_a_lead_without_its_follower_names_a_node_that_does_not_respond(
    hosts: tuple[Host, Host], config: Path
) -> None:
    with both(hosts, config) as (lead, follower):
        follower.process.kill()
        lead.process.wait(DEADLINE_S)
        eventually(lambda: not follower.left_over(), "the end of the follower's nodes")
    assert lead.process.returncode == 1, lead.text
    causes = [f"failed: {node} hangs: no answer" for node in (ROBOT, ESTIMATOR)]
    assert any(cause in lead.text for cause in causes), lead.text
    assert not lead.left_over()
