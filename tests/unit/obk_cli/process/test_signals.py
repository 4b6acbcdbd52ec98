"""Ctrl-C stops a command even if a library drops the exception or converts it to an error."""

import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from obk_cli.process.signals import (
    accept_interrupt,
    handle_end_signals,
    insist_on_interrupt,
    is_interrupted,
    until_interrupt,
)

OBK: Final = Path(sys.executable).with_name("obk")
VALID_CONFIG: Final = Path(__file__).parents[3] / "cases/accept/OBK004/topic_twice.yaml"
REPEATS_S: Final = 0.5
"""Longer than a few repetitions of the interrupt."""
ENDLESS_S: Final = 60.0


class Callback:
    """An object whose removal interrupts in a callback, where Python drops exceptions."""


@pytest.fixture(autouse=True)
def _as_before() -> Iterator[None]:
    changed = (signal.SIGINT, signal.SIGALRM, signal.SIGHUP)
    before = {number: signal.getsignal(number) for number in changed}
    signal.signal(signal.SIGHUP, lambda *_: None)  # the tests may run under nohup
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def reported(monkeypatch: pytest.MonkeyPatch) -> list[type[BaseException]]:
    """The exceptions that Python dropped and reported."""
    types: list[type[BaseException]] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda about: types.append(about.exc_type))
    return types


def interrupt() -> None:
    signal.raise_signal(signal.SIGINT)


def interrupt_with_cleanup(done: list[str]) -> None:
    try:
        try:
            interrupt()
        finally:
            time.sleep(REPEATS_S)
            done.append("finally")
    except KeyboardInterrupt:
        time.sleep(REPEATS_S)
        done.append("except")
        raise


def interrupt_a_library() -> None:
    try:
        interrupt()
    except KeyboardInterrupt:
        raise RuntimeError("cannot release un-acquired lock") from None


def interrupt_a_build() -> None:
    try:
        interrupt()
    except KeyboardInterrupt:
        accept_interrupt()
        raise ValueError("interrupted") from None


def test_an_interrupt_that_python_drops_is_raised_again(
    reported: list[type[BaseException]],
) -> None:
    removed = [Callback()]
    watch = weakref.ref(removed[0], lambda _: interrupt())

    def drop_an_interrupt() -> None:
        removed.clear()
        time.sleep(ENDLESS_S)

    with pytest.raises(KeyboardInterrupt), insist_on_interrupt():
        drop_an_interrupt()
    assert (watch(), reported) == (None, [])


def test_cleanup_after_an_interrupt_is_not_interrupted() -> None:
    done: list[str] = []
    with pytest.raises(KeyboardInterrupt), insist_on_interrupt():
        interrupt_with_cleanup(done)
    assert done == ["finally", "except"]


def test_an_error_that_a_library_makes_of_an_interrupt_is_one() -> None:
    with pytest.raises(KeyboardInterrupt), insist_on_interrupt():
        interrupt_a_library()
    assert not is_interrupted()


def test_an_accepted_interrupt_is_not_raised_again() -> None:
    with insist_on_interrupt():
        with until_interrupt():
            interrupt()
        time.sleep(REPEATS_S)
        with pytest.raises(ValueError, match="interrupted"):
            interrupt_a_build()
        time.sleep(REPEATS_S)


def test_without_an_interrupt_errors_and_timers_stay() -> None:
    before = signal.setitimer(signal.ITIMER_REAL, ENDLESS_S)
    handler = signal.getsignal(signal.SIGALRM)
    with pytest.raises(RuntimeError), insist_on_interrupt():
        raise RuntimeError
    assert signal.getsignal(signal.SIGALRM) is handler
    assert signal.setitimer(signal.ITIMER_REAL, *before)[0] > 0.0


def test_a_command_that_a_script_starts_in_the_background_ends_on_ctrl_c() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell does for `command &`
    command = [OBK, "validate", "--watch", VALID_CONFIG]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    signal.signal(signal.SIGINT, before)
    with process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        try:
            assert process.wait(ENDLESS_S) == 0
        finally:
            process.kill()


def test_each_signal_is_received_and_handlers_are_restored() -> None:
    received: list[signal.Signals] = []
    before = signal.getsignal(signal.SIGTERM)
    with handle_end_signals(received.append):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.raise_signal(number)
    assert received == [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
    assert signal.getsignal(signal.SIGTERM) is before


def test_under_nohup_the_terminal_may_close_and_sigint_still_works() -> None:
    received: list[signal.Signals] = []
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with handle_end_signals(received.append):
        signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGINT)
    assert received == [signal.SIGINT]
