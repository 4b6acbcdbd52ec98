"""What a launcher is asked to do, and what is left to a participant of the command's own."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, cast

import pytest

from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.looking import errands
from obk_cli.looking.errands import (
    call_by_launcher,
    delay_by_launcher,
    message_by_launcher,
    rates_by_launcher,
)
from obk_cli.looking.graph import End, TopicSeen
from obk_cli.looking.place import Place
from obk_cli.looking.rates import LAUNCHER_COUNTS_S
from obk_cli.looking.selection import parse_selection
from obk_cli.ros.raw_subscription import Offer

from .definitions import FIELDS

TYPES = {**FIELDS, "p/srv/Pause_Request": {"data": "boolean"}, "pkg/msg/State": FIELDS["pkg/State"]}
OFFER = cast(Offer, None)
PLACE = Place(environment=cast(Any, SimpleNamespace(domain=7)), runs={}, nobody_s=1.0)


class Launcher:
    """A launcher's look with one topic and one service; notes what it was asked to do."""

    def __init__(self, types: Mapping[str, Mapping[str, str]] = TYPES) -> None:
        self._types = types
        self.asked: list[tuple[Any, ...]] = []

    def nodes(self) -> tuple[str, ...]:
        return ("/arm/n",)

    def topic_types(self) -> dict[str, tuple[str, ...]]:
        return {"/arm/state": ("pkg/msg/State",)}

    def service_types(self) -> dict[str, tuple[str, ...]]:
        return {"/arm/pause": ("p/srv/Pause",)}

    def topic(self, name: str) -> TopicSeen:
        end = End(node="/arm/n", role="publisher", msg_type="pkg/msg/State", qos=OFFER)
        return TopicSeen(name=name, msg_types=("pkg/msg/State",), publishers=(end,))

    def settle(self, *_: object) -> bool:
        return True

    def wait_for(self, probe: Any, _timeout_s: float) -> Any:
        return probe()

    def has_type(self, name: str) -> bool:
        return name in self._types

    def fields_of(self, name: str) -> Mapping[str, str]:
        return self._types[name]

    def call(self, *question: Any) -> Any:
        self.asked.append(question)
        return {"success": True}

    def next_message(self, *question: Any) -> Any:
        self.asked.append(question)
        return {"count": 1}

    def rates(self, *question: Any) -> Any:
        self.asked.append(question)
        return {}

    def delay(self, *question: Any) -> Any:
        self.asked.append(question)
        return None, 3


def launcher(monkeypatch: pytest.MonkeyPatch, look: Launcher | None) -> None:
    """Have this launcher in the place; None: none."""
    monkeypatch.setattr(errands, "ask_launcher", lambda _: look)


def test_what_is_meant_is_asked_for_by_its_full_name(monkeypatch: pytest.MonkeyPatch) -> None:
    look = Launcher()
    launcher(monkeypatch, look)
    count = parse_selection("count")
    assert call_by_launcher(PLACE, "pause", None, {"data": True}, 2.0) == {"success": True}
    assert message_by_launcher(PLACE, "state", [count], 2.0) == {"count": 1}
    assert rates_by_launcher(PLACE, ["state"], 0.5, 2.0) == {}
    assert delay_by_launcher(PLACE, "state", 10, 0.5, 2.0) == ("/arm/state", None, 3)
    assert look.asked == [
        ("/arm/pause", "p/srv/Pause", {"data": True}, 2.0),
        ("/arm/state", "pkg/msg/State", 2.0),
        ({"/arm/state": "pkg/msg/State"}, 0.5),
        ("/arm/state", "pkg/msg/State", 10, 0.5),
    ]


def test_nothing_is_asked_where_words_do_not_fit_the_type(monkeypatch: pytest.MonkeyPatch) -> None:
    look = Launcher()
    launcher(monkeypatch, look)
    with pytest.raises(MisuseError, match="data: expected true or false, got `3`"):
        call_by_launcher(PLACE, "pause", None, {"data": 3}, 2.0)
    with pytest.raises(CommandFailedError, match="has no field `cuont`"):
        message_by_launcher(PLACE, "state", [parse_selection("cuont")], 2.0)
    assert look.asked == []


@pytest.mark.parametrize("look", [None, Launcher(types={})])
def test_without_a_launcher_that_has_the_type_it_is_left_to_others(
    monkeypatch: pytest.MonkeyPatch, look: Launcher | None
) -> None:
    launcher(monkeypatch, look)
    assert call_by_launcher(PLACE, "pause", None, {"data": True}, 2.0) is None
    assert message_by_launcher(PLACE, "state", [], 2.0) is None
    assert delay_by_launcher(PLACE, "state", 10, 0.5, 2.0) is None
    assert look is None or look.asked == []


def test_a_long_count_is_not_the_launchers(monkeypatch: pytest.MonkeyPatch) -> None:
    look = Launcher()
    launcher(monkeypatch, look)
    long_s = 1.5 * LAUNCHER_COUNTS_S
    assert rates_by_launcher(PLACE, ["state"], long_s, 2.0) is None
    assert delay_by_launcher(PLACE, "state", 10, long_s, 2.0) is None
    assert look.asked == []
