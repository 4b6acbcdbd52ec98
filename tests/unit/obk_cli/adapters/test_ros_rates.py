"""Diagnostics as values, whoever published them."""

from types import SimpleNamespace
from typing import Any

from obelisk_spec.rates import Rate, rate_values
from obk_cli.adapters.ros_rates import listen_to_rates, rates_told
from obk_cli.launch.events import RatesReported

RATE = Rate(
    name="timer_ctrl",
    wanted_hz=100.0,
    measured_hz=87.5,
    ticks=42,
    overruns=3,
    late_p50_us=81.9,
    late_p99_us=2752.5,
    late_max_us=3000.0,
    standing="off",
)


def status(name: str, node: str, values: tuple[tuple[str, str], ...]) -> Any:
    pairs = [SimpleNamespace(key=key, value=value) for key, value in values]
    return SimpleNamespace(level=b"\x01", name=name, hardware_id=node, values=pairs)


def test_what_else_is_told_beside_rates_is_left_aside() -> None:
    own = status("c: timer_ctrl", "/c", rate_values(RATE))
    other = status("c: motor", "/c", (("celsius", "41"),))
    assert rates_told(SimpleNamespace(status=[other, own])) == RatesReported(
        node="/c", rates=(RATE,)
    )


def test_diagnostics_without_rates_are_none() -> None:
    assert rates_told(SimpleNamespace(status=[])) is None
    assert rates_told(SimpleNamespace(status=[status("lidar: x", "lidar", ())])) is None


def test_only_the_nodes_that_are_listened_to_are_heard() -> None:
    heard: list[RatesReported] = []
    callbacks: list[Any] = []
    node = SimpleNamespace(create_subscription=lambda *given: callbacks.append(given[2]))
    listen_to_rates(node, ("/c", "/d"), heard.append)
    for name in ("/c", "/elsewhere", "/d"):
        callbacks[0](SimpleNamespace(status=[status("c: timer_ctrl", name, rate_values(RATE))]))
    assert [told.node for told in heard] == ["/c", "/d"]
