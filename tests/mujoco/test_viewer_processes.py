"""Viewers as processes: their reports, access control, and shutdown with the robot."""

import inspect
import os
import signal
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import urlsplit

import mujoco
import psutil
import pytest

from obelisk_py.core.sim.mujoco.viewers.priority import lower_priority
from obelisk_py.core.sim.mujoco.viewers.processes import ViewerProcess
from obelisk_py.core.sim.mujoco.viewers.program import VIEWER_KINDS
from obelisk_py.core.time_slice import shorten_time_slice, time_slice_ns

from ..waiting import DEADLINE_S, eventually  # noqa: TID252 - shared by folders of tests
from .viewer_host import Viewable

pytestmark = pytest.mark.mujoco

ROOT = Path(__file__).resolve().parents[2]

ROBOT = """
import dataclasses, sys, time, mujoco
from obelisk_py.core.sim.mujoco.viewers.processes import ViewerProcess
from tests.mujoco.viewer_host import Viewable

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
host = dataclasses.replace(Viewable(model).host, show_page=lambda url: print(url, flush=True))
web = ViewerProcess("web", ("0", "arm"), model, data, notify=print, host=host)
print(web.pid, flush=True)
while True:
    web.states.send()
    time.sleep(0.01)
"""


class Viewed:
    """A viewer and its reports so far."""

    def __init__(self, model: mujoco.MjModel, kind: str, *arguments: str) -> None:
        self.viewable = Viewable(model)
        self.output = self.viewable.messages
        self.token = self.viewable.token
        self.viewer = ViewerProcess(
            kind,
            (*arguments, "arm"),
            model,
            self.viewable.simulation.data,
            notify=self.viewable.host.notify,
            host=self.viewable.host,
        )

    @property
    def url(self) -> str:
        """The URL of the page, waited for."""
        eventually(lambda: self.viewable.pages or self.output, "a report of the viewer")
        assert self.output == []
        return self.viewable.pages[0]

    @property
    def port(self) -> int:
        """The port of the page, waited for."""
        return urlsplit(self.url).port or 0


@pytest.fixture
def looking(dummy: mujoco.MjModel) -> Iterator[Callable[..., Viewed]]:
    with ExitStack() as closing:

        def look(kind: str, *arguments: str) -> Viewed:
            viewed = Viewed(dummy, kind, *arguments)
            closing.callback(viewed.viewer.close)
            return viewed

        yield look


def the_port_is_free(port: int) -> bool:
    with socket.socket() as trial:
        return trial.connect_ex(("127.0.0.1", port)) != 0


def listens_on(pid: int) -> set[str]:
    connections = psutil.Process(pid).net_connections("inet")
    return {c.laddr.ip for c in connections if c.status == psutil.CONN_LISTEN}


def test_a_thread_with_lower_priority_is_an_ordinary_one() -> None:
    found: list[tuple[int, int, int]] = []

    def draw() -> None:
        shorten_time_slice()
        # Unlike a real-time policy, this one is available to every user.
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        lower_priority()
        niceness = os.getpriority(os.PRIO_PROCESS, 0)
        found.append((os.sched_getscheduler(0), niceness, time_slice_ns()))

    thread = threading.Thread(target=draw)
    thread.start()
    thread.join()
    niceness = min(19, os.getpriority(os.PRIO_PROCESS, 0) + 10)
    assert found == [(os.SCHED_OTHER, niceness, time_slice_ns())]


def test_a_page_is_local_has_low_priority_and_ends_when_closed(
    looking: Callable[..., Viewed],
) -> None:
    pytest.importorskip("mjviser")
    viewed = looking("web", "0")
    pid = viewed.viewer.pid
    with urllib.request.urlopen(viewed.url, timeout=DEADLINE_S) as page:
        content = page.read()
        cookie = page.headers["Set-Cookie"]
    assert b"<title>dummy - obk</title>" in content
    assert cookie == (f"obk_{viewed.port}={viewed.token}; HttpOnly; Path=/; SameSite=Strict")
    assert listens_on(pid) == {"127.0.0.1"}
    assert psutil.Process(pid).nice() > psutil.Process().nice()
    viewed.viewer.close()
    assert not psutil.pid_exists(pid)
    assert the_port_is_free(viewed.port)
    assert viewed.viewable.pages == [viewed.url, ""]


def test_only_the_page_itself_with_its_token_gets_a_websocket(
    looking: Callable[..., Viewed],
) -> None:
    pytest.importorskip("mjviser")
    viewed = looking("web", "0")
    port, token = viewed.port, viewed.token
    here, right = f"127.0.0.1:{port}", f"obk_{port}={token}"
    for host, origin, cookie, answer in (
        (here, f"http://{here}", right, b"101"),
        (here, f"http://{here}", f"a=b; {right}", b"101"),
        (f"localhost:{port}", f"http://localhost:{port}", right, b"101"),
        (here, f"http://{here}", "", b"403"),
        (here, f"http://{here}", f"obk_{port}={token[:-1]}", b"403"),
        (here, f"http://{here}", f"obk_{port + 1}={token}", b"403"),
        (here, f"http://{here}", "obk_[=]", b"403"),
        (here, "https://robot.example", right, b"403"),
        (here, "http://127.0.0.1:1", right, b"403"),
        (here, "null", right, b"403"),
        (f"robot.example:{port}", f"http://robot.example:{port}", right, b"403"),
    ):
        status = websocket_status(port, host, origin, cookie)
        assert status == answer, (host, origin, cookie)
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(f"http://{here}/", timeout=DEADLINE_S)
    with refused.value as response:
        assert response.code == 403


def test_the_token_is_in_no_command_line(looking: Callable[..., Viewed]) -> None:
    pytest.importorskip("mjviser")
    viewed = looking("web", "0")
    assert viewed.token in viewed.url
    assert viewed.token not in " ".join(psutil.Process(viewed.viewer.pid).cmdline())


def websocket_status(port: int, host: str, origin: str, cookie: str) -> bytes:
    """The HTTP status for a browser that requests a WebSocket."""
    headers = (
        f"Host: {host}",
        f"Origin: {origin}",
        *((f"Cookie: {cookie}",) if cookie else ()),
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version: 13",
    )
    with socket.create_connection(("127.0.0.1", port), timeout=DEADLINE_S) as line:
        line.sendall("\r\n".join(("GET / HTTP/1.1", *headers, "", "")).encode())
        return line.makefile("rb").readline().split()[1]


@pytest.mark.slow
def test_two_viewers_have_different_ports(looking: Callable[..., Viewed]) -> None:
    pytest.importorskip("mjviser")
    one, other = looking("web", "0"), looking("web", "0")
    assert one.port != other.port


def test_a_port_that_is_taken_is_reported(looking: Callable[..., Viewed]) -> None:
    pytest.importorskip("mjviser")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        viewed = looking("web", str(port))
        eventually(lambda: viewed.output, "the rejection")
    assert viewed.output == [
        (
            "warning",
            f"the web viewer cannot use port {port} (`viewer_port`): Address already in use; "
            "choose another port, or 0 for a free one; the simulation continues without it",
        )
    ]


def test_a_missing_library_is_reported_with_its_extra(
    looking: Callable[..., Viewed], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    missing = 'raise ModuleNotFoundError("No module named \'viser\'", name="viser")\n'
    (tmp_path / "viser.py").write_text(missing)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    viewed = looking("web", "0")
    eventually(lambda: viewed.output, "the rejection")
    ((severity, text),) = viewed.output
    assert severity == "warning"
    assert "`viser`" in text
    assert "obelisk-cli[viewer]" in text


def test_a_window_without_a_display_is_reported_and_sending_continues(
    looking: Callable[..., Viewed], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    viewed = looking("native")
    eventually(lambda: viewed.output, "the rejection")
    ((severity, text),) = viewed.output
    assert severity == "warning"
    assert text.startswith("the native viewer needs a display")
    assert text.endswith("; the simulation continues without it")
    viewed.viewer.states.send()


def test_a_display_that_cannot_be_opened_is_reported(
    looking: Callable[..., Viewed], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", ":9999")
    viewed = looking("native")
    eventually(lambda: viewed.output, "the rejection")
    assert viewed.output == [
        (
            "warning",
            "the native viewer needs a display, and `:9999` cannot be opened; the `web` viewer (a "
            "page in the browser) works without one; the simulation continues without it",
        )
    ]


@pytest.mark.slow
def test_one_that_dies_is_reported_once(looking: Callable[..., Viewed]) -> None:
    pytest.importorskip("mjviser")
    viewed = looking("web", "0")
    assert viewed.port
    os.kill(viewed.viewer.pid, signal.SIGKILL)
    eventually(lambda: viewed.output, "the report of its end")
    severity, text = viewed.output[0]
    assert severity == "warning"
    assert text.startswith(
        "the web viewer has exited (signal 9); the simulation continues without it"
    )
    for _ in range(3):
        viewed.viewer.states.send()
    viewed.viewer.close()
    assert len(viewed.output) == 1


def test_it_ends_with_a_robot_that_is_killed(dummy_xml: Path) -> None:
    pytest.importorskip("mjviser")
    with subprocess.Popen(
        [sys.executable, "-c", ROBOT, dummy_xml], stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as robot:
        assert robot.stdout is not None
        viewer = psutil.Process(int(robot.stdout.readline()))
        assert "/?token=" in robot.stdout.readline()
        robot.kill()
    eventually(lambda: not viewer.is_running(), "its end")


@pytest.mark.parametrize("kind", VIEWER_KINDS)
def test_a_viewer_loads_no_ros(kind: str) -> None:
    program = f"import sys, {VIEWER_KINDS[kind].module}; print('rclpy' in sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert loaded.stdout == "False\n"


def test_the_page_cannot_be_tunnelled_to_another_host() -> None:
    pytest.importorskip("mjviser")
    import viser._viser

    from obelisk_py.core.sim.mujoco.viewers.web import _Server

    # The failure of a browser's WebSocket request, as viser receives it.
    assert "self.request_share_url" in inspect.getsource(viser._viser)
    assert object.__new__(_Server).request_share_url() is None
