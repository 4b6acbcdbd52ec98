"""Signals that ask for the end, those that were ignored before among them."""

import signal
from collections.abc import Iterator

import pytest

from obk_cli.process.signals import handle_end_signals


@pytest.fixture(autouse=True)
def _as_before() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGHUP)}
    signal.signal(signal.SIGHUP, lambda *_: None)  # the tests may run under nohup
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_each_is_heard_and_afterwards_all_is_as_before() -> None:
    heard: list[signal.Signals] = []
    before = signal.getsignal(signal.SIGTERM)
    with handle_end_signals(heard.append):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.raise_signal(number)
    assert heard == [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
    assert signal.getsignal(signal.SIGTERM) is before


def test_under_nohup_the_terminal_may_go_and_sigint_still_ends() -> None:
    heard: list[signal.Signals] = []
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with handle_end_signals(heard.append):
        signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGINT)
    assert heard == [signal.SIGINT]
