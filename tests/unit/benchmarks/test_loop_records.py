"""Records of nodes that go on while they are taken."""

from types import SimpleNamespace

from benchmarks.loop.record import Notes, record_of


def test_an_arrival_whose_delay_is_not_noted_yet_is_left_out() -> None:
    notes = Notes()
    notes.arrivals_ns.extend((10, 20))
    notes.delays_ns.append(1)
    timer = SimpleNamespace(timer_period_ns=5, time_until_next_call=lambda: 0)
    record = record_of("sim", notes, timer)
    assert (record.arrivals_ns, record.delays_ns) == ((10,), (1,))
