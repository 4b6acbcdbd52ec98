"""Addresses at which a running stack can be reached, from the kernel's list of sockets."""

from pathlib import Path

import psutil
import pytest

from .stack import DUMMY, Launched, launched

pytestmark = [pytest.mark.ros, pytest.mark.timeout(400)]

PLANTED = """\
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="planted" is_default_profile="true">
    <rtps><useBuiltinTransports>true</useBuiltinTransports></rtps>
  </participant>
</profiles>
"""
"""Fast DDS settings that make it reachable from all hosts."""


def addresses(run: Launched) -> set[str]:
    """The addresses of this host at which the launcher and its child processes have a socket."""
    processes = [psutil.Process(run.process.pid), *run.descendants]
    return {end.laddr.ip for one in processes for end in one.net_connections("inet") if end.laddr}


def test_no_socket_is_open_to_another_host_whatever_the_working_folder_contains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DEFAULT_FASTRTPS_PROFILES.xml", "DEFAULT_FASTDDS_PROFILES.xml"):
        (tmp_path / name).write_text(PLANTED)
    (tmp_path / "numpy.py").write_text("raise SystemExit('this file was run')")
    (tmp_path / "mcap.py").write_text("raise SystemExit('this file was run')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
    with launched(DUMMY, "--quiet", "--record") as run:
        assert addresses(run) == {"127.0.0.1"}
    assert run.process.returncode == 0, run.text
    assert any(line.startswith("recorded ") for line in run.lines), run.text
