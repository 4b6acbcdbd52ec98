"""`obk topic hz` and `delay` interrupted by Ctrl-C, without ROS."""

from collections.abc import Iterator
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any, Final

import pytest

from obk_cli.cli.topic_rates import _measure_delay, _measure_rates
from obk_cli.introspect import resolve
from obk_cli.ros import meters
from obk_cli.ros import participant as ros_look
from obk_cli.ros import raw_subscription as ros_listen
from obk_cli.ros import types as ros_types
from obk_cli.ros.graph import TopicInfo
from obk_cli.ros.meters import TopicRate

PLACE: Final[Any] = SimpleNamespace(environment=None, modules=lambda _: ())
MS: Final = 1_000_000


class Interrupted:
    """A meter that Ctrl-C interrupts in its first turn."""

    def __init__(self, *_: object) -> None: ...

    def add(self, *_: object) -> None: ...

    def turn(self) -> None:
        raise KeyboardInterrupt

    def rates(self) -> dict[str, TopicRate]:
        return {"/est": TopicRate(count=7, lost=0, seen=7, window_s=0.3, rate_hz=20.0)}


@pytest.fixture(autouse=True)
def _topic(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = TopicInfo(name="/est", msg_types=("p/msg/M",))
    look = SimpleNamespace(subscribe=lambda *_: None)
    monkeypatch.setattr(ros_look, "open_participant", lambda *_: nullcontext(look))
    monkeypatch.setattr(resolve, "find_topic", lambda *_: seen)
    for name in ("find_type", "raw_type"):
        monkeypatch.setattr(ros_types, name, lambda *_: object)


def test_the_rate_since_the_last_report_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(meters, "RosMeter", Interrupted)
    for duration_s in (None, 60.0):
        with pytest.raises(KeyboardInterrupt):
            _measure_rates(PLACE, ["est"], 10.0, duration_s, 5.0, is_json=False)
        assert capsys.readouterr().out.startswith("/est     20.00 Hz ")


def test_the_delay_since_the_last_report_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def arrived(_: object) -> Iterator[tuple[int, int]]:
        yield 5 * MS, 3 * MS
        raise KeyboardInterrupt

    monkeypatch.setattr(ros_listen, "arrived", arrived)
    monkeypatch.setattr(meters, "stamp_getter", lambda *_: lambda message: message)
    with pytest.raises(KeyboardInterrupt):
        _measure_delay(PLACE, "est", 10, None, 5.0, is_json=False)
    assert capsys.readouterr().out.startswith("mean 2.000 ms ")
