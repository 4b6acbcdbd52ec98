"""The frequency at which the middleware counts subscribers."""

from obelisk_py.core.sim.mujoco.outputs import SubscriberCheck

MS = 1_000_000


def test_subscribers_are_counted_immediately_and_then_every_five_milliseconds():
    now_ns, listeners, asked = 7, 0, []

    def count():
        asked.append(now_ns)
        return listeners

    audience = SubscriberCheck(count, lambda: now_ns)
    assert not audience.has_subscribers()
    listeners = 2
    now_ns += 5 * MS - 1
    assert not audience.has_subscribers()
    now_ns += 1
    assert audience.has_subscribers()
    listeners = 0
    now_ns += 5 * MS
    assert not audience.has_subscribers()
    assert asked == [7, 7 + 5 * MS, 7 + 10 * MS]
