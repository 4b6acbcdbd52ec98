"""The process that an ID identifies."""

import os
import subprocess
import sys

from obk_cli.process.identity import is_process, start_s, this_process


def test_a_process_is_known_by_its_number_and_its_start() -> None:
    pid, started = this_process()
    assert pid == os.getpid()
    assert is_process(pid, started)
    assert not is_process(pid, started - 0.01)


def test_a_zombie_is_no_process() -> None:
    with subprocess.Popen([sys.executable, "-I", "-S", "-c", ""]) as child:
        os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
        assert start_s(child.pid) is None
        child.wait()
        assert start_s(child.pid) is None
