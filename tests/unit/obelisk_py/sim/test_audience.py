"""When the middleware is asked who listens."""

from obelisk_py.core.sim.mujoco.audience import Audience

MS = 1_000_000


def test_who_listens_is_asked_at_once_and_then_every_five_milliseconds():
    now_ns, listeners, asked = 7, 0, []

    def count():
        asked.append(now_ns)
        return listeners

    audience = Audience(count, lambda: now_ns)
    assert not audience.is_there()
    listeners = 2
    now_ns += 5 * MS - 1
    assert not audience.is_there()
    now_ns += 1
    assert audience.is_there()
    listeners = 0
    now_ns += 5 * MS
    assert not audience.is_there()
    assert asked == [7, 7 + 5 * MS, 7 + 10 * MS]
