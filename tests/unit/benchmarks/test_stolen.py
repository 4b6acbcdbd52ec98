"""Stolen time, and what a bare timer keeps."""

from types import SimpleNamespace

import pytest

from benchmarks import stolen


def test_stolen_time_is_a_share_of_a_core_since_the_beginning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    steals, clock = iter([7.0, 7.5]), iter([100.0, 110.0])
    monkeypatch.setattr(stolen.psutil, "cpu_times", lambda: SimpleNamespace(steal=next(steals)))
    monkeypatch.setattr(stolen.time, "monotonic", lambda: next(clock))
    assert stolen.StolenTime().percent() == 5.0


@pytest.mark.parametrize(("percent", "is_told"), [(5.0, False), (6.0, True)])
def test_only_too_much_of_it_is_told(
    percent: float, is_told: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    stolen.warn_of_stolen_time(percent)
    assert ("the host took 6 % of a core" in capsys.readouterr().err) is is_told
