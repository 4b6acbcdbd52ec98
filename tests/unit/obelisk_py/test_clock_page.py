import os
from collections.abc import Iterator

import pytest

from obelisk_py.core.clock_page import (
    NEVER_NS,
    ClockPage,
    ClockWriter,
    open_clock_page,
    open_clock_writer,
)
from obelisk_spec.runtime_protocol import (
    CLOCK_PAGE,
    CLOCK_VARIABLE,
    ClockDescriptors,
    clock_page_bytes,
    parse_clock,
)

MS = 1_000_000


@pytest.fixture
def descriptors() -> Iterator[ClockDescriptors]:
    page = os.memfd_create(CLOCK_PAGE)
    wakes = tuple(os.eventfd(0, os.EFD_NONBLOCK) for _ in range(2))
    os.ftruncate(page, clock_page_bytes(len(wakes)))
    yield ClockDescriptors(page=page, own=1, wakes=wakes)
    for fd in (page, *wakes):
        os.close(fd)


def is_signalled(fd: int) -> bool:
    try:
        return os.eventfd_read(fd) > 0
    except BlockingIOError:
        return False


def test_a_text_names_the_descriptors() -> None:
    descriptors = ClockDescriptors(page=5, own=1, wakes=(6, 7))
    assert parse_clock(str(descriptors)) == descriptors
    for text in ("", "5", "5,0", "5,2,6,7", "5,-1,6", "5,x,6"):
        assert parse_clock(text) is None


def test_the_time_is_that_of_the_latest_step(descriptors: ClockDescriptors) -> None:
    page, writer = ClockPage(descriptors), ClockWriter(descriptors)
    assert page.time_ns == 0
    writer.advance(3 * MS)
    assert page.time_ns == 3 * MS


def test_a_process_is_woken_once_at_its_time(descriptors: ClockDescriptors) -> None:
    page, writer = ClockPage(descriptors), ClockWriter(descriptors)
    page.set_due(2 * MS)
    writer.advance(MS)
    assert not is_signalled(page.wake_fd)
    writer.advance(2 * MS)
    assert is_signalled(page.wake_fd)
    writer.advance(3 * MS)
    assert not is_signalled(page.wake_fd)
    page.set_due(3 * MS)  # written too late for that step
    writer.advance(4 * MS)
    assert is_signalled(page.wake_fd)
    assert not is_signalled(descriptors.wakes[0])


def test_a_closed_page_asks_for_no_wake_up(descriptors: ClockDescriptors) -> None:
    page, writer = ClockPage(descriptors), ClockWriter(descriptors)
    page.set_due(MS)
    page.close()
    writer.advance(MS)
    writer.advance(NEVER_NS - 1)
    assert not is_signalled(page.wake_fd)


def test_a_jump_back_wakes_every_process(descriptors: ClockDescriptors) -> None:
    page, writer = ClockPage(descriptors), ClockWriter(descriptors)
    writer.restart(0)
    assert page.epoch == 0  # the first start of a run is not a jump
    page.set_due(2 * MS)
    writer.advance(2 * MS)
    assert is_signalled(page.wake_fd)
    # As after a restart of a simulator.
    writer = ClockWriter(descriptors)
    writer.restart(0)
    assert (page.time_ns, page.epoch) == (0, 1)
    assert all(is_signalled(fd) for fd in descriptors.wakes)
    writer.advance(2 * MS)
    assert is_signalled(page.wake_fd)


def test_a_process_finds_the_page_that_it_inherited(
    descriptors: ClockDescriptors, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CLOCK_VARIABLE, str(descriptors))
    writer = open_clock_writer()
    assert writer is not None
    with open_clock_page() as page:
        assert page is not None
        writer.advance(MS)
        assert page.time_ns == MS
    assert not any(os.get_inheritable(fd) for fd in (descriptors.page, *descriptors.wakes))


def test_a_process_with_other_files_at_these_numbers_has_no_page(
    descriptors: ClockDescriptors, monkeypatch: pytest.MonkeyPatch
) -> None:
    page, wake = descriptors.page, descriptors.wakes[0]
    for text in ("", f"{wake},0,{wake}", f"{page},0,{page}", f"{page},0,99999"):
        monkeypatch.setenv(CLOCK_VARIABLE, text)
        assert open_clock_writer() is None
        with open_clock_page() as none:
            assert none is None
