"""How to subscribe so that every publisher is heard, and what a recording keeps of their offers.

In: what publishers offer. Out: what to ask for, and the text that rosbag2 reads when it plays a
recording. Source: rosbag2, `offered_qos_profiles` of a topic, metadata of version 9.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

__all__ = ["Offer", "Request", "offers_text", "request_for"]

_NS: Final = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Offer:
    """The quality of service of one publisher, in the words of rmw: `keep_last`, `reliable`."""

    history: str
    depth: int
    reliability: str
    durability: str
    liveliness: str
    deadline_ns: int
    lifespan_ns: int
    lease_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What a subscription asks for."""

    is_reliable: bool = True
    is_transient_local: bool = False
    """Whether what was published before is wanted too."""


def request_for(offers: Collection[Offer], *, is_light: bool = False) -> Request:
    """The most that all of them have to offer; without any, what Obelisk's nodes offer.

    Args:
        offers: one for each publisher.
        is_light: let them send each message once, without waiting for a word that it came: a third
            less work. What was published before is not had so; where it is wanted, it is reliable.
    """
    request = Request(
        is_reliable=all(offer.reliability == "reliable" for offer in offers),
        is_transient_local=bool(offers)
        and all(offer.durability == "transient_local" for offer in offers),
    )
    return request if request.is_transient_local or not is_light else Request(is_reliable=False)


def offers_text(offers: Iterable[Offer]) -> str:
    """The offers as YAML, one for each publisher."""
    import yaml  # for this alone; other users of this module are quicker without

    return yaml.safe_dump([_profile(offer) for offer in offers], sort_keys=False)


def _profile(offer: Offer) -> Mapping[str, object]:
    return {
        "history": offer.history,
        "depth": offer.depth,
        "reliability": offer.reliability,
        "durability": offer.durability,
        "deadline": _time(offer.deadline_ns),
        "lifespan": _time(offer.lifespan_ns),
        "liveliness": offer.liveliness,
        "liveliness_lease_duration": _time(offer.lease_ns),
        "avoid_ros_namespace_conventions": False,
    }


def _time(nanoseconds: int) -> Mapping[str, int]:
    return {"sec": nanoseconds // _NS, "nsec": nanoseconds % _NS}
