"""What a recording asks of publishers, and what it keeps of their offers."""

from dataclasses import replace

import yaml

from obk_cli.recording.qos import Offer, Request, offers_text, request_for

FOR_EVER = 2**63 - 1
RELIABLE = Offer(
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


def test_what_all_publishers_offer_is_asked_for() -> None:
    assert request_for([]) == Request(is_reliable=True, is_transient_local=False)
    assert request_for([RELIABLE]) == Request(is_reliable=True, is_transient_local=False)
    assert request_for([LATCHED]) == Request(is_reliable=True, is_transient_local=True)


def test_one_weaker_publisher_among_them_is_heard_too() -> None:
    assert request_for([LATCHED, RELIABLE]) == Request()
    assert request_for([RELIABLE, UNRELIABLE]) == Request(is_reliable=False)


def test_a_light_one_is_reliable_only_for_what_was_published_before() -> None:
    assert request_for([], is_light=True) == Request(is_reliable=False)
    assert request_for([RELIABLE], is_light=True) == Request(is_reliable=False)
    assert request_for([LATCHED], is_light=True) == request_for([LATCHED])


def test_offers_are_kept_in_the_words_of_rosbag2() -> None:
    first, second = yaml.safe_load(offers_text([RELIABLE, UNRELIABLE]))
    assert first == {
        "history": "keep_last",
        "depth": 10,
        "reliability": "reliable",
        "durability": "volatile",
        "deadline": {"sec": 1, "nsec": 500_000_000},
        "lifespan": {"sec": 9223372036, "nsec": 854775807},
        "liveliness": "automatic",
        "liveliness_lease_duration": {"sec": 9223372036, "nsec": 854775807},
        "avoid_ros_namespace_conventions": False,
    }
    assert second["reliability"] == "best_effort"
