"""The QoS that raw subscriptions request, and the messages that they miss."""

from dataclasses import replace

from obk_cli.ros.raw_subscription import DropCounter, OfferedQos, RequestedQos, requested_qos

FOR_EVER = 2**63 - 1
RELIABLE = OfferedQos(
    history="keep_last",
    depth=10,
    reliability="reliable",
    durability="volatile",
    liveliness="automatic",
    deadline_ns=1_500_000_000,
    lifespan_ns=FOR_EVER,
    lease_ns=FOR_EVER,
)
LATCHED = replace(RELIABLE, durability="transient_local")
UNRELIABLE = replace(RELIABLE, reliability="best_effort")


def test_the_qos_that_all_publishers_offer_is_requested() -> None:
    assert requested_qos([]) == RequestedQos(is_reliable=True, is_transient_local=False)
    assert requested_qos([RELIABLE]) == RequestedQos(is_reliable=True, is_transient_local=False)
    assert requested_qos([LATCHED]) == RequestedQos(is_reliable=True, is_transient_local=True)


def test_one_weaker_publisher_among_them_is_received_too() -> None:
    assert requested_qos([LATCHED, RELIABLE]) == RequestedQos()
    assert requested_qos([RELIABLE, UNRELIABLE]) == RequestedQos(is_reliable=False)


def test_a_light_subscription_is_reliable_only_for_latched_messages() -> None:
    assert requested_qos([], is_light=True) == RequestedQos(is_reliable=False)
    assert requested_qos([RELIABLE], is_light=True) == RequestedQos(is_reliable=False)
    assert requested_qos([LATCHED], is_light=True) == requested_qos([LATCHED])


def counted(*sequence: int, publishers: int = 1) -> tuple[int, int]:
    counter = DropCounter()
    for number in sequence:
        counter.take(number, publishers)
    return counter.count, counter.dropped


def test_gaps_in_the_numbers_are_lost_messages() -> None:
    assert counted(1, 2, 3) == (3, 0)
    assert counted(1, 2, 5, 6, 9) == (5, 4)


def test_messages_from_before_the_recording_are_not_lost() -> None:
    assert counted(100, 101) == (2, 0)


def test_a_publisher_that_begins_again_has_lost_nothing() -> None:
    assert counted(1, 2, 3, 1, 2) == (5, 0)
    assert counted(1, 1) == (2, 0)


def test_numbers_of_several_publishers_give_no_losses() -> None:
    assert counted(1, 50, 2, 51, publishers=2) == (4, 0)
