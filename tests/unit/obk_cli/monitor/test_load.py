"""Resource use of processes."""

import os

from obk_cli.monitor.observers import OwnCpuUse, ProcessLoads


def test_running_processes_are_measured_and_ended_ones_left_out() -> None:
    gone = 2**22 + 1  # above the kernel's maximum
    loads = ProcessLoads()
    first = loads.measure({os.getpid(), gone})
    assert set(first) == {os.getpid()}
    again = loads.measure({os.getpid()})[os.getpid()]
    assert again.memory_bytes > 1_000_000
    assert again.uptime_s >= first[os.getpid()].uptime_s > 0


def test_working_costs_more_than_nothing() -> None:
    cost = OwnCpuUse()
    sum(range(1_000_000))
    assert cost.percent() > 0
