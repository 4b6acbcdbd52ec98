"""What the fuzzer counts as a finding."""

import pytest
from hypothesis.errors import UnsatisfiedAssumption
from tests.fuzz import bounds
from tests.fuzz.bounds import Bounded


def test_what_is_raised_is_noted_once_with_its_place_and_input() -> None:
    def fail(text: str) -> None:
        raise KeyError(text)

    bounded = Bounded(fail)
    bounded(text="a")
    bounded(text="b")
    assert bounded.executions == 2
    ((place, what),) = bounded.findings.items()
    assert place.startswith("test_fuzz_bounds.py:")
    assert what == "KeyError: 'a'; input {'text': 'a'}"


def test_what_takes_too_long_is_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([0.0, 2.5])
    monkeypatch.setattr(bounds.time, "process_time", lambda: next(times))
    bounded = Bounded(lambda: None)
    bounded()
    assert bounded.findings == {"time": "2.5 s; input {}"}


def test_an_input_that_is_none_is_no_finding() -> None:
    def reject() -> None:
        raise UnsatisfiedAssumption

    bounded = Bounded(reject)
    with pytest.raises(UnsatisfiedAssumption):
        bounded()
    assert not bounded.findings
